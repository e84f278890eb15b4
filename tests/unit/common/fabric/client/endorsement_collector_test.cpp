#include "common/fabric/client/endorsement_collector.hpp"

#include <gtest/gtest.h>

namespace ledgerline::fabric {
namespace {

using Step = EndorsementCollector::Next;

EndorsementCollector::Answer endorsed(const std::string& organisation, const std::string& result = "r") {
  return {organisation, {}, {}, result, organisation};
}
EndorsementCollector::Answer refused(const std::string& organisation) { return {organisation, {}, "tello1: no"}; }
EndorsementCollector::Answer failed(const std::string& organisation) {
  return {organisation, "connection refused", {}};
}

EndorsementCollector gathering(const std::vector<EndorsementCollector::Answer>& answers, bool any = false) {
  EndorsementCollector all({"Org1MSP", "Org2MSP", "Org3MSP"}, 2, any);
  for (const auto& one : answers) all.add(one);
  return all;
}

TEST(EndorsementCollector, WaitsForAllUntilItIsLateAndGoesWithTwo) {
  const EndorsementCollector two = gathering({endorsed("Org1MSP"), endorsed("Org2MSP")});
  EXPECT_EQ(two.next(false), Step::wait) << "the third may be the keys' owner";
  EXPECT_EQ(two.next(true), Step::send);
  EXPECT_EQ(two.best().size(), 2u);
  EXPECT_EQ(two.problem(), "Org3MSP: no answer in time");
}

TEST(EndorsementCollector, APeerThatIsDownHoldsNothingUpAndIsNamed) {
  const EndorsementCollector two = gathering({endorsed("Org1MSP"), failed("Org2MSP"), endorsed("Org3MSP")});
  EXPECT_EQ(two.next(false), Step::send);
  EXPECT_EQ(two.problem(), "Org2MSP: connection refused");
}

TEST(EndorsementCollector, OneAloneGoesOnlyWhereOneWillDo) {
  const std::vector<EndorsementCollector::Answer> answers{endorsed("Org1MSP"), failed("Org2MSP"), failed("Org3MSP")};
  EXPECT_EQ(gathering(answers).next(false), Step::unavailable);
  EXPECT_EQ(gathering(answers, true).next(false), Step::send);
}

TEST(EndorsementCollector, ResultsThatDifferAreAskedForAgainUnlessTwoAgree) {
  EXPECT_EQ(gathering({endorsed("Org1MSP", "a"), endorsed("Org2MSP", "b"), failed("Org3MSP")}).next(false),
            Step::again);
  EXPECT_EQ(gathering({endorsed("Org1MSP", "a"), refused("Org2MSP"), failed("Org3MSP")}).next(false), Step::again);
  const EndorsementCollector agreed =
      gathering({endorsed("Org1MSP", "a"), endorsed("Org2MSP", "b"), endorsed("Org3MSP", "b")});
  EXPECT_EQ(agreed.next(false), Step::send);
  EXPECT_EQ(agreed.best().front()->organisation, "Org2MSP");
}

TEST(EndorsementCollector, ARefusalCountsWhereNobodyEndorses) {
  const EndorsementCollector none = gathering({refused("Org1MSP"), failed("Org2MSP"), refused("Org3MSP")});
  EXPECT_EQ(none.next(false), Step::refused);
  EXPECT_EQ(none.problem(), "tello1: no");
  EXPECT_EQ(gathering({}).next(true), Step::unavailable);
}

}  // namespace
}  // namespace ledgerline::fabric
