#include <gmock/gmock.h>

#include "chaincode/node/core/tx/messages.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "peer/transaction.pb.h"
#include "tests/unit/chaincode/command_call.hpp"
#include "tests/unit/chaincode/node/core/fake_network.hpp"

/// Floods of envelopes that call themselves urgent, beside a drone that flies. The disk takes 5 ms a block, and a block
/// takes one envelope: 200 a second, which is less than the flood sends.
namespace ledgerline::node {
namespace {

using ::testing::ElementsAre;

constexpr TimeNs block_ns = 5 * ns_per_ms;

class UrgencyTest : public ::testing::Test {
 protected:
  UrgencyTest() {
    net.submit(net.admin1, "enroll", enroll_call(net.host.name, {"tello1"}));
    net.submit(net.admin1, "grant", grant_call("Org2MSP", {"tello1"}));
    net.submit(net.admin1, "enroll", enroll_call(guard.name, {}, OPERATOR));
    net.submit(net.admin2, "enroll", enroll_call(net.pilot.name, {}, OPERATOR));
    net.submit(net.pilot, "acquire", "tello1");
    net.submit(net.host, "set", note("tello1/odom"));
  }

  std::string tx_of(const std::string& envelope) const { return fabric::read_form(envelope).channel_header.tx_id(); }

  /// A call as its sender makes it up, with these endorsements.
  std::string made_up(const crypto::SigningIdentity& who, const std::string& function,
                      const std::vector<protos::Endorsement>& endorsements) {
    const auto proposal = read_signed_proposal(net.propose(who, function, "tello1").signed_proposal)->proposal;
    protos::ProposalResponsePayload response;
    response.set_proposal_hash(
        fabric::proposal_hash(proposal.header.channel_header(), proposal.header.signature_header(), proposal.payload));
    protos::ChaincodeAction action;  // as a contract's, so that nothing but its endorsements is wrong
    action.mutable_chaincode_id()->set_name("ledgerline");
    response.set_extension(action.SerializeAsString());
    return *fabric::sign_envelope(who, make_envelope(proposal, response.SerializeAsString(), endorsements));
  }

  struct Seen {
    TimeNs state_ns = 0;     ///< the maximum time from a state's order to its block
    std::size_t states = 0;  ///< committed
    std::size_t stop_blocks = 0;
    std::size_t refused = 0;
  };
  /// Two seconds of a flood of 350 a second, made by `next`, beside 20 states a second. Then somebody says stop.
  template <typename Next>
  Seen flood(Next next) {
    Seen seen;
    std::map<std::string, TimeNs> states;
    std::string stop;
    double due = 0;
    for (int turn = 0; turn < 500 && seen.stop_blocks == 0; ++turn) {
      net.now.monotonic_ns += block_ns;
      for (due += 350 * 5e-3; due >= 1; --due) seen.refused += net.core->order(next(), net.now).code != Code::ok;
      if (turn % 10 == 0) {
        const std::string state = net.endorsed(net.host, "set", note("tello1/odom", std::to_string(turn)));
        EXPECT_EQ(net.core->order(state, net.now).code, Code::ok);
        states[tx_of(state)] = net.now.monotonic_ns;
      }
      if (turn == 400) {
        stop = net.endorsed(guard, "stop", "tello1");
        EXPECT_EQ(net.core->order(stop, net.now).code, Code::ok);
        stop = tx_of(stop);
        stop_height = net.chain.size();
      }
      const auto block = net.core->cut(net.now);
      if (!block) continue;
      net.keep(*block);
      for (const TxStatus& status : block->transactions) {
        if (status.tx_id == stop) seen.stop_blocks = net.chain.size() - stop_height;
        const auto state = states.find(status.tx_id);
        if (state == states.end()) continue;
        EXPECT_EQ(status.code, protos::VALID);
        seen.state_ns = std::max(seen.state_ns, net.now.monotonic_ns - state->second);
        ++seen.states;
        states.erase(state);
      }
    }
    return seen;
  }
  static void expect_no_harm(const Seen& seen) {
    EXPECT_GE(seen.states, 38U);
    EXPECT_LE(seen.state_ns, 10 * block_ns);
    EXPECT_GE(seen.stop_blocks, 1U);
    EXPECT_LE(seen.stop_blocks, 2U) << "one that is not urgent may be before it";
  }

  FakeNetwork net;
  std::size_t stop_height = 0;
  const crypto::SigningIdentity guard = crypto::make_test_identity({"Org1MSP", "CN=guard"});
  const crypto::SigningIdentity member = crypto::make_test_identity({"Org3MSP", "CN=User2"});
};

TEST_F(UrgencyTest, UnendorsedStopsOfAMemberWithoutARoleAreNotUrgent) {
  expect_no_harm(flood([&] { return made_up(member, "stop", {}); }));
}

TEST_F(UrgencyTest, ThoseOfManyIdentitiesNeither) {
  int who = 0;
  expect_no_harm(flood([&] {
    return made_up(crypto::make_test_identity({"Org3MSP", "CN=s" + std::to_string(++who % 300)}), "stop", {});
  }));
}

TEST_F(UrgencyTest, AForgedEndorsementEarnsNothing) {
  protos::Endorsement forged;
  forged.set_endorser(crypto::make_test_identity({"Org1MSP", "CN=peer0"}).serialized);
  forged.set_signature("signature");
  expect_no_harm(flood([&] { return made_up(member, "stop", {forged}); }));
}

TEST_F(UrgencyTest, TheEndorsementOfAnothersStopEarnsNothing) {
  const auto genuine = *fabric::open_transaction(net.endorsed(guard, "stop", "tello1"));
  expect_no_harm(flood([&] {
    auto copy = *fabric::open_transaction(made_up(member, "stop", {}));
    *copy.action.mutable_action() = genuine.action.action();
    return *fabric::sign_envelope(member, copy.bytes());
  }));
}

TEST_F(UrgencyTest, AnEndorsementByAMemberWhoIsNoPeerEarnsNothing) {
  const auto endorsed_by_itself = [&] {
    auto own = *fabric::open_transaction(made_up(member, "stop", {}));
    protos::Endorsement& endorsement = *own.action.mutable_action()->add_endorsements();
    endorsement.set_endorser(member.serialized);
    endorsement.set_signature(
        *member.signer->sign(own.action.action().proposal_response_payload() + member.serialized));
    return *fabric::sign_envelope(member, own.bytes());
  };
  net.core->set_nearly_full(true);
  EXPECT_EQ(net.core->order(endorsed_by_itself(), net.now).code, Code::unavailable)
      << "a full disk takes what is urgent alone";
  net.core->set_nearly_full(false);
  expect_no_harm(flood(endorsed_by_itself));
}

TEST_F(UrgencyTest, AStopThatIsInABlockAlreadyIsNotUrgentFromAnySender) {
  const std::string stop = net.endorsed(guard, "stop", "tello1");
  ASSERT_EQ(net.core->order(stop, net.now).code, Code::ok);
  ASSERT_THAT(net.commit(), ElementsAre(protos::VALID));
  expect_no_harm(flood([&] { return stop; }));
}

TEST_F(UrgencyTest, WhoSendsTheStateOfAHostAgainSpendsNothingOfItsShare) {
  const std::string state = net.endorsed(net.host, "set", note("tello1/odom", std::string(60'000, 'x')));
  ASSERT_EQ(net.core->order(state, net.now).code, Code::ok);
  ASSERT_THAT(net.commit(), ElementsAre(protos::VALID));
  const Seen seen = flood([&] { return state; });
  EXPECT_GT(seen.refused, 0U) << "all together have one identity's share";
  expect_no_harm(seen);
}

TEST_F(UrgencyTest, EndorsedOnesThatTurnOutInvalidSpendTheirBudget) {
  net.submit(crypto::make_test_identity({"Org3MSP", "CN=Admin"}), "enroll", enroll_call(member.name, {}, OPERATOR));
  GrantCall grant;
  grant.add_drones("tello1");
  grant.mutable_grant()->mutable_to()->set_msp_id("Org3MSP");
  grant.mutable_grant()->set_stop(true);
  net.submit(net.admin1, "grant", grant.SerializeAsString());
  // Each clears the same stop: the first one does.
  ASSERT_THAT(net.submit(member, "stop", "tello1"), ElementsAre(protos::VALID));
  std::vector<std::string> clears;
  for (int i = 0; i < 900; ++i) clears.push_back(net.endorsed(member, "clear_stop", "tello1"));
  std::size_t at = 0;
  const Seen seen = flood([&] { return clears.at(at++ % clears.size()); });
  EXPECT_GE(seen.states, 38U);
  EXPECT_LE(seen.state_ns, 10 * block_ns) << "one of five is not urgent";
  EXPECT_LE(seen.stop_blocks, 2U);
}

TEST_F(UrgencyTest, WhoSendsWhatIsInvalidIsKeptOutAfterAWhileAndForgivenLater) {
  const Seen seen = flood([&] { return made_up(member, "stop", {}); });
  expect_no_harm(seen);
  std::size_t taken = 0;
  for (int second = 0; second < 10; ++second) {
    for (int i = 0; i < 350; ++i) taken += net.core->order(made_up(member, "stop", {}), net.now).code == Code::ok;
    net.now.monotonic_ns += ns_per_s;
    net.commit();
  }
  EXPECT_LE(taken, 500U + 10 * 50 + 350) << "what is forgiven, and what waited when the bound was reached";
  const auto colleague = crypto::make_test_identity({"Org3MSP", "CN=User1"});
  EXPECT_EQ(net.core->order(net.endorsed(colleague, "set", note("Org3MSP/note")), net.now).code, Code::ok)
      << "one identity does not spend what its organisation has";
  net.now.monotonic_ns += 60 * ns_per_s;
  EXPECT_EQ(net.core->order(made_up(member, "stop", {}), net.now).code, Code::ok);
}

TEST_F(UrgencyTest, WhoseTransactionsAreValidGoesOnThoughItsOrganisationSendsInvalidOnes) {
  const auto colleague = crypto::make_test_identity({"Org3MSP", "CN=User1"});
  ASSERT_THAT(net.submit(colleague, "set", note("Org3MSP/note")), ElementsAre(protos::VALID));
  for (int who = 0; who < 30; ++who) {
    const auto sybil = crypto::make_test_identity({"Org3MSP", "CN=s" + std::to_string(who)});
    for (int i = 0; i < 60; ++i) net.core->order(made_up(sybil, "stop", {}), net.now);
    net.commit();
  }
  const auto newest = crypto::make_test_identity({"Org3MSP", "CN=newest"});
  EXPECT_EQ(net.core->order(made_up(newest, "stop", {}), net.now).code, Code::unavailable);
  EXPECT_THAT(net.submit(colleague, "set", note("Org3MSP/note")), ElementsAre(protos::VALID));
  EXPECT_THAT(net.submit(net.host, "set", note("tello1/odom")), ElementsAre(protos::VALID));
}

TEST_F(UrgencyTest, OnAFullDiskTheEndorsedOnesAloneAreTaken) {
  net.core->set_nearly_full(true);
  EXPECT_EQ(net.core->order(made_up(member, "stop", {}), net.now).code, Code::unavailable);
  EXPECT_EQ(net.core->order(net.endorsed(net.host, "set", note("tello1/odom")), net.now).code, Code::unavailable);
  EXPECT_EQ(net.core->order(net.endorsed(net.pilot, "command", command_call(1).SerializeAsString()), net.now).code,
            Code::ok);
  EXPECT_EQ(net.core->order(net.endorsed(guard, "stop", "tello1"), net.now).code, Code::ok);
}

}  // namespace
}  // namespace ledgerline::node
