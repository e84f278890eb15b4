#include "ground/core/lease/request_answers.hpp"

#include <gmock/gmock.h>

#include "common/access/access.hpp"
#include "common/access/grants.hpp"
#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Kind = fabric::Outcome::Kind;

const crypto::IdentityName other_name{"Org2MSP", "CN=User2@org2"};

class RequestAnswersTest : public ::testing::Test {
 protected:
  void rule(RequestRule rule) {
    config.request_rule = rule;
    config.request_after_ns = 10 * ns_per_s;
  }
  void request(const crypto::IdentityName& who, std::uint32_t priority) {
    add_request(record, to_message(who), nullptr, priority);
    ASSERT_TRUE(leases.set(record));
  }
  void gone(const crypto::IdentityName& who) {
    remove_request(record, to_message(who));
    ASSERT_TRUE(leases.set(record));
  }
  void step(TimeNs now) {
    notes.clear();
    answers.step(now, leases, id, sent, notes);
  }
  AnswerCall newest() const {
    AnswerCall call;
    EXPECT_TRUE(call.ParseFromString(sent.back().call.args.at(0)));
    return call;
  }

  FlightConfig config = config_for(1);
  FlightTransactions counters;
  LeaseBook leases{config, counters};
  RequestAnswers answers{config};
  Control record = control_record("tello1", operator_name);
  std::uint64_t id = 1;
  std::vector<Submission> sent;
  std::vector<std::string> notes;
};

TEST_F(RequestAnswersTest, OurOperatorIsReportedOnceAndWithoutARuleNobodyAnswersForHim) {
  request(other_name, 3);
  step(0);
  EXPECT_THAT(notes,
              ElementsAre("tello1: Org2MSP CN=User2@org2 requests it, at priority 3 (ours: 0): hand_over or deny "
                          "answers it"));
  for (int s = 1; s < 100; ++s) {
    step(s * ns_per_s);
    EXPECT_THAT(notes, IsEmpty());
  }
  request(other_name, 4);
  step(100 * ns_per_s);
  EXPECT_THAT(notes, ElementsAre(HasSubstr("priority 4"))) << "it asks for more";
  EXPECT_THAT(sent, IsEmpty());
}

TEST_F(RequestAnswersTest, TheRuleHandsOverToTheHighestPriorityOfThoseThatAreDue) {
  rule(RequestRule::hand_over);
  request(outsider_name, 2);
  request(other_name, 3);
  step(0);
  EXPECT_THAT(notes, ElementsAre(HasSubstr("handed over in 10 s, unless you answer first"), HasSubstr("handed over")));
  step(10 * ns_per_s - 1);
  EXPECT_THAT(sent, IsEmpty());
  request({"Org2MSP", "CN=late"}, 9);
  step(10 * ns_per_s);
  step(10 * ns_per_s + 1);
  ASSERT_EQ(sent.size(), 1u) << "one at a time";
  EXPECT_EQ(sent[0].call.function, "hand_over");
  EXPECT_TRUE(sent[0].urgent);
  EXPECT_EQ(newest().to().subject(), other_name.subject);
}

TEST_F(RequestAnswersTest, TheRuleDeniesOneAfterTheOther) {
  rule(RequestRule::deny);
  request(outsider_name, 2);
  request(other_name, 3);
  step(0);
  step(10 * ns_per_s);
  ASSERT_EQ(sent.size(), 1u);
  EXPECT_EQ(sent[0].call.function, "deny");
  EXPECT_EQ(answers.on_outcome(11 * ns_per_s, fabric::Outcome::failed(Kind::committed, ""), 1)->problem, "");
  gone(other_name);
  step(11 * ns_per_s);
  ASSERT_EQ(sent.size(), 2u);
  EXPECT_EQ(newest().to().subject(), outsider_name.subject);
}

TEST_F(RequestAnswersTest, WhoAnswersFirstOrWithdrawsLeavesTheRuleNothingToDo) {
  rule(RequestRule::deny);
  request(other_name, 3);
  step(0);
  gone(other_name);
  step(20 * ns_per_s);
  request(other_name, 3);
  step(21 * ns_per_s);
  EXPECT_THAT(notes, ElementsAre(HasSubstr("requests it"))) << "requested again";
  record.clear_holder();
  record.set_epoch(2);
  ASSERT_TRUE(leases.set(record));
  step(60 * ns_per_s);
  EXPECT_THAT(sent, IsEmpty()) << "it is not ours any more";
}

TEST_F(RequestAnswersTest, OfADroneThatWeOnlyCommandItsHolderAnswers) {
  rule(RequestRule::hand_over);
  record = delegated_record("tello1", "CN=pilot");
  request(other_name, 3);
  for (int s = 0; s < 100; ++s) {
    step(s * ns_per_s);
    EXPECT_THAT(notes, IsEmpty());
  }
  EXPECT_THAT(sent, IsEmpty()) << "the ledger would refuse it";
}

TEST_F(RequestAnswersTest, AnotherDelegateIsAnotherRequest) {
  request(other_name, 3);
  step(0);
  const Identity station = to_message({"Org2MSP", "CN=station"});
  add_request(record, to_message(other_name), &station, 3);
  ASSERT_TRUE(leases.set(record));
  step(ns_per_s);
  EXPECT_THAT(notes, ElementsAre(HasSubstr("requests it, for Org2MSP CN=station to command, at priority 3")));
}

TEST_F(RequestAnswersTest, AnAnswerGoesAgainOverAConflictAndIsLeftToTheOperatorWhereItFails) {
  rule(RequestRule::hand_over);
  request(other_name, 3);
  step(0);
  step(10 * ns_per_s);
  fabric::Outcome conflict = fabric::Outcome::failed(Kind::invalidated, "");
  conflict.code = 11;
  EXPECT_EQ(answers.on_outcome(10 * ns_per_s, conflict, 1)->problem, "");
  step(11 * ns_per_s);
  ASSERT_EQ(sent.size(), 2u);
  const auto refused = fabric::Outcome::failed(Kind::refused, "chaincode response 500, tello1: it may not fly it");
  EXPECT_EQ(answers.on_outcome(11 * ns_per_s, refused, 2)->problem,
            "no answer to Org2MSP CN=User2@org2's request: tello1: it may not fly it; it is left to you");
  step(60 * ns_per_s);
  EXPECT_EQ(sent.size(), 2u);
  EXPECT_FALSE(answers.on_outcome(60 * ns_per_s, refused, 2));
}

}  // namespace
}  // namespace ledgerline::ground
