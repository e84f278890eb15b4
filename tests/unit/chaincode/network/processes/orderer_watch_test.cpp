#include "chaincode/network/processes/orderer_watch.hpp"

#include <gmock/gmock.h>

namespace ledgerline::network {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

class OrdererWatchTest : public testing::Test {
 protected:
  /// Names of those that hang, looked for over so many seconds.
  std::vector<std::string> update(int seconds) {
    std::vector<std::string> all;
    for (int i = 0; i < seconds; ++i) {
      now += OrdererWatch::between_ns;
      for (auto& name : watch.update(now, states)) all.push_back(std::move(name));
    }
    return all;
  }

  std::vector<Processes::State> states{{"orderer1", "", 10, 0, 0}, {"peer1", "", 11, 0, 0}};
  std::map<std::string, RaftSign> signs{{"teleop", {false, 5}}};
  int asked = 0;
  TimeNs now = 0;
  OrdererWatch watch{{"teleop"}, [this](int orderer) {
                       EXPECT_EQ(orderer, 1);
                       ++asked;
                       return signs;
                     }};
};

TEST_F(OrdererWatchTest, OneThatNeitherLeadsNorWritesHangsAndIsNamedOnceAStart) {
  EXPECT_THAT(update(9), IsEmpty());
  EXPECT_THAT(update(30), ElementsAre("orderer1"));
  states[0].pid = 12;
  EXPECT_THAT(update(30), ElementsAre("orderer1")) << "it was started again, and hangs again";
}

TEST_F(OrdererWatchTest, OneThatLeadsIsNotAskedAgain) {
  signs["teleop"].leads = true;
  EXPECT_THAT(update(3), IsEmpty());
  EXPECT_EQ(asked, 1);
}

TEST_F(OrdererWatchTest, OneThatDoesNotRunIsNotAsked) {
  states[0].pid = 0;
  EXPECT_THAT(update(30), IsEmpty());
  EXPECT_EQ(asked, 0);
}

TEST_F(OrdererWatchTest, NobodyIsAskedMoreThanOnceASecond) {
  for (int i = 0; i < 20; ++i) watch.update(now + i, states);
  EXPECT_EQ(asked, 1);
}

}  // namespace
}  // namespace ledgerline::network
