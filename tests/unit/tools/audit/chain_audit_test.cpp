#include "tools/audit/chain_audit.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "ground/service/missions/approvals.hpp"
#include "peer/transaction.pb.h"
#include "tests/unit/tools/audit/signed_ledger.hpp"

namespace ledgerline::audit {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<std::string> texts(const ChainAudit& audit) {
  std::vector<std::string> all;
  for (const Finding& finding : audit.findings()) all.push_back(to_text(finding));
  return all;
}

common::Block parsed(const std::string& bytes) {
  common::Block block;
  EXPECT_TRUE(block.ParseFromString(bytes));
  return block;
}

class ChainAuditTest : public ::testing::Test {
 protected:
  ChainAuditTest() {
    ledger.enroll();
    ledger.acquire();
    for (int i = 1; i <= 3; ++i) ids.push_back(ledger.send(ledger.pilot, "command", ledger.command_call(i, 1, i)));
    ledger.commit();
  }
  std::size_t last() const { return ledger.chain.size() - 1; }

  SignedLedger ledger;
  std::vector<std::string> ids;  ///< of the last block
};

TEST_F(ChainAuditTest, NothingIsFoundInAnHonestChain) {
  const ChainAudit audit = audited(ledger.chain, ledger.trust());
  EXPECT_THAT(texts(audit), IsEmpty());
  EXPECT_EQ(audit.counts().blocks, ledger.chain.size());
  EXPECT_EQ(audit.counts().config_blocks, 1U);
  EXPECT_EQ(audit.counts().transactions, audit.counts().valid);
  EXPECT_EQ(audit.counts().endorsements, 3 * (audit.counts().transactions - 1));
  const std::string verdict_text =
      fmt::format("nothing found: everything is as it must be up to block {} (hash {}); later blocks were not shown",
                  last(), audit.newest_hash());
  EXPECT_THAT(to_table(audit, {"teleop", "memory", "anchor"}), EndsWith(verdict_text + "\n"));
  EXPECT_EQ(to_json(audit, {})["verdict"], verdict_text);
  EXPECT_EQ(to_json(audit, {})["newest_block"], last());
  EXPECT_THAT(to_table(audit, {}), HasSubstr("  valid: 1 acquire, 3 command, 2 enroll, 1 grant\n"));
}

TEST_F(ChainAuditTest, LastBlocksThatWereLeftOutAreFoundByTheNewestHash) {
  Trust trust = ledger.trust();
  trust.newest = audited(ledger.chain, ledger.trust()).newest_hash();
  EXPECT_THAT(texts(audited(ledger.chain, trust)), IsEmpty());
  ledger.chain.pop_back();
  EXPECT_THAT(texts(audited(ledger.chain, ledger.trust())), IsEmpty()) << "nothing shows it";
  EXPECT_THAT(texts(audited(ledger.chain, trust)), ElementsAre(HasSubstr("not " + trust.newest)));
}

TEST_F(ChainAuditTest, TellsOfTheSpanAndTheDronesThatWereAskedForAndChecksAll) {
  const DroneReport all = audited(ledger.chain, ledger.trust()).report().drones().at("tello1");
  const Commands& commands = all.commands.begin()->second;
  ASSERT_EQ(commands.valid, 3U);
  const ChainAudit later = audited(ledger.chain, ledger.trust(), {commands.last.time_ns, commands.last.time_ns});
  const DroneReport& reported = later.report().drones().at("tello1");
  EXPECT_EQ(reported.commands.begin()->second.valid, 1U);
  EXPECT_EQ(reported.holders.count(), 1U) << "held since before";
  EXPECT_EQ(reported.events.count(), 0U) << "enrolled and granted before";
  EXPECT_EQ(later.counts().transactions, audited(ledger.chain, ledger.trust()).counts().transactions);

  AuditRequest asked{"teleop", "memory", "anchor", {"tello7"}, {}};
  EXPECT_TRUE(to_json(later, asked)["drones"].empty());
  asked.drones.insert("tello1");
  EXPECT_TRUE(to_json(later, asked)["drones"].contains("tello1"));
}

TEST_F(ChainAuditTest, TellsOfAnchorsInTheirSignersWords) {
  AnchorCall call;
  call.set_digest(std::string(32, 'd'));
  call.set_what("approves mission survey");
  ledger.submit(ledger.pilot, "anchor", call.SerializeAsString());
  const ChainAudit audit = audited(ledger.chain, ledger.trust());
  ASSERT_EQ(audit.report().anchors().count(), 1U);
  EXPECT_THAT(audit.report().anchors().all()[0].what, HasSubstr("\"approves mission survey\", SHA-256 6464"));
  EXPECT_THAT(to_table(audit, {"teleop", "memory", "anchor"}), HasSubstr("approves mission survey"));
  EXPECT_THAT(to_table(audit, {"teleop", "memory", "anchor"}),
              HasSubstr(", transaction " + audit.report().anchors().all()[0].when.tx_id + "\n"));
}

TEST_F(ChainAuditTest, TellsOfApprovalsThatStandWhenTheSpanBegins) {
  const ground::service::ApprovalTerms terms({"Org2MSP", "CN=station"}, 7'200);
  const auto anchor = [&](const std::string& what) {
    AnchorCall call;
    call.set_digest(std::string(32, static_cast<char>('a' + what.size() % 26)));
    call.set_what(what);
    ledger.submit(ledger.pilot, "anchor", call.SerializeAsString());
  };
  const DroneReport before = audited(ledger.chain, ledger.trust()).report().drones().at("tello1");
  const TimeNs now_ns = before.commands.begin()->second.last.time_ns;
  anchor(terms.approval_words("survey", now_ns / ns_per_s));
  anchor(terms.approval_words("old", now_ns / ns_per_s - 86'400));
  anchor(terms.withdrawal_words("other"));
  anchor("a camera's film");
  const TimeSpan span{now_ns + 60 * ns_per_s, std::numeric_limits<TimeNs>::max()};
  const ChainAudit audit = audited(ledger.chain, ledger.trust(), span);
  ASSERT_EQ(audit.report().anchors().count(), 2U);
  EXPECT_THAT(audit.report().anchors().all()[0].what, HasSubstr("mission survey may be flown until"));
  EXPECT_THAT(audit.report().anchors().all()[1].what, HasSubstr("mission other may not be flown any more"));
  EXPECT_EQ(audited(ledger.chain, ledger.trust(), {0, 1}).report().anchors().count(), 0U) << "given behind the span";

  const AuditRequest asked{"teleop", "memory", "anchor", {"tello1"}, span};
  EXPECT_THAT(to_table(audit, asked), HasSubstr("the whole chain: "));
  EXPECT_THAT(to_table(audit, asked), HasSubstr("  anchored before, and in force in that time:\n    \"mission survey"));
  EXPECT_THAT(to_table(audit, asked), ::testing::Not(HasSubstr("  anchored:\n")));
  EXPECT_EQ(to_json(audit, asked)["anchors"][0]["before"], true);
  EXPECT_EQ(to_json(audit, asked)["asked"]["counted"], "in that time, of all drones");
  EXPECT_THAT(to_table(audit, {"teleop", "memory", "anchor"}), ::testing::Not(HasSubstr("the whole chain: ")));
}

TEST_F(ChainAuditTest, AFlagThatIsNotTheVerdictIsFound) {
  common::Block block = parsed(ledger.chain.back());
  std::string& flags = *block.mutable_metadata()->mutable_metadata(common::TRANSACTIONS_FILTER);
  ASSERT_EQ(flags, std::string(3, '\0'));
  flags[1] = static_cast<char>(protos::MVCC_READ_CONFLICT);
  ledger.chain.back() = block.SerializeAsString();
  const ChainAudit audit = audited(ledger.chain, ledger.trust());
  ASSERT_THAT(texts(audit), ElementsAre(AllOf(HasSubstr("transaction 1 (" + ids[1] + ")"),
                                              HasSubstr("flag is MVCC_READ_CONFLICT, but it is VALID"))));
  EXPECT_THAT(to_table(audit, {"teleop", "memory", "anchor"}), HasSubstr("\nfirst difference: block"));
  EXPECT_FALSE(to_json(audit, {})["ok"].get<bool>());
}

TEST_F(ChainAuditTest, AHiddenStopIsFound) {
  ledger.submit(ledger.pilot, "stop", SignedLedger::drones_call());
  common::Block block = parsed(ledger.chain.back());
  (*block.mutable_metadata()->mutable_metadata(common::TRANSACTIONS_FILTER))[0] =
      static_cast<char>(protos::ENDORSEMENT_POLICY_FAILURE);
  ledger.chain.back() = block.SerializeAsString();
  EXPECT_THAT(texts(audited(ledger.chain, ledger.trust())),
              ElementsAre(HasSubstr("flag is ENDORSEMENT_POLICY_FAILURE, but it is VALID")));
}

TEST_F(ChainAuditTest, AChangedTransactionIsNamed) {
  common::Block block = parsed(ledger.chain.back());
  std::string& envelope = *block.mutable_data()->mutable_data(2);
  envelope[envelope.size() / 2] ^= 1;
  ledger.chain.back() = block.SerializeAsString();
  const ChainAudit audit = audited(ledger.chain, ledger.trust());
  ASSERT_FALSE(audit.findings().empty());
  EXPECT_EQ(audit.findings()[0].block, last());
  EXPECT_EQ(audit.findings()[0].transaction, 2U);
}

TEST_F(ChainAuditTest, DataThatNobodyFlaggedDifferentlyAreStillHeldAgainstTheirHash) {
  common::Block block = parsed(ledger.chain.back());
  block.mutable_data()->mutable_data()->RemoveLast();
  block.mutable_metadata()->mutable_metadata(common::TRANSACTIONS_FILTER)->pop_back();
  ledger.chain.back() = block.SerializeAsString();
  EXPECT_THAT(texts(audited(ledger.chain, ledger.trust())),
              ElementsAre(fmt::format("block {}: its data does not match its data hash", last())));
}

TEST_F(ChainAuditTest, ABlockThatIsMissingIsFoundAndSaysWhere) {
  ledger.chain.erase(ledger.chain.begin() + 2);
  const ChainAudit audit = audited(ledger.chain, ledger.trust());
  ASSERT_FALSE(audit.findings().empty());
  EXPECT_THAT(to_text(audit.findings()[0]), HasSubstr("block 2: block 3 is in its place"));
}

TEST_F(ChainAuditTest, OrderersOfSomebodyElseAreFound) {
  const fabric::Organisation others{"OrdererMSP"};
  common::Block block = parsed(ledger.chain.back());
  fabric::SignedChain::sign(block, others.member("orderer"));
  ledger.chain.back() = block.SerializeAsString();
  EXPECT_THAT(texts(audited(ledger.chain, ledger.trust())),
              ElementsAre(HasSubstr("orderers' signatures do not satisfy the channel's policy")));
}

TEST_F(ChainAuditTest, AForkThatTheOrderersSignedIsFound) {
  common::Block block = parsed(ledger.chain.back());
  (*block.mutable_header()->mutable_previous_hash())[0] ^= 1;
  fabric::SignedChain::sign(block, ledger.orderer);
  ledger.chain.back() = block.SerializeAsString();
  EXPECT_THAT(texts(audited(ledger.chain, ledger.trust())),
              ElementsAre(HasSubstr("previous hash is not that of the block before")));
}

TEST_F(ChainAuditTest, BytesThatNobodySignedAmongTheSignaturesAreFound) {
  common::Block block = parsed(ledger.chain.back());
  block.mutable_metadata()->mutable_metadata(common::SIGNATURES)->append("\x7a\x01!");  // a field that nobody knows
  ledger.chain.back() = block.SerializeAsString();
  EXPECT_THAT(texts(audited(ledger.chain, ledger.trust())), ElementsAre(HasSubstr("bytes among its signatures")));
}

TEST_F(ChainAuditTest, TheFirstBlocksSignaturesAreTheAnchors) {
  common::Block block = parsed(ledger.chain[0]);
  block.mutable_metadata()->mutable_metadata(common::SIGNATURES)->append("\x7a\x01!");
  const Trust trust = ledger.trust();
  ledger.chain[0] = block.SerializeAsString();
  EXPECT_THAT(texts(audited(ledger.chain, trust)), Contains(HasSubstr("not those of the trust anchor")));
}

/// Block 2 configures the channel again, with other orderers.
class ReconfiguredTest : public ::testing::Test {
 protected:
  ReconfiguredTest() {
    made.add("x", &made.orderer_);
    made.add(made.config_of(made.second_), &made.orderer_, 0);
    made.add("y", &made.other_, 2);
    for (const common::Block& block : made.chain_) chain.push_back(block.SerializeAsString());
  }
  fabric::SignedChain made;
  std::vector<std::string> chain;
};

TEST_F(ReconfiguredTest, AnyConfigurationOfTheChainIsAnAnchor) {
  for (const std::size_t anchor : {0U, 2U}) EXPECT_THAT(texts(audited(chain, {"teleop", chain[anchor]})), IsEmpty());
}

TEST_F(ReconfiguredTest, AChainThatEndsBeforeItsAnchorProvesNothing) {
  const std::string anchor = chain[2];
  chain.resize(2);
  EXPECT_THAT(texts(audited(chain, {"teleop", anchor})),
              ElementsAre(HasSubstr("ends before block 2, the trust anchor")));
}

TEST_F(ReconfiguredTest, OrderersOfBeforeSignNothingAnyMore) {
  fabric::SignedChain::sign(made.chain_[3], made.orderer_, 2);
  chain[3] = made.chain_[3].SerializeAsString();
  EXPECT_THAT(texts(audited(chain, {"teleop", chain[0]})),
              ElementsAre(HasSubstr("orderers' signatures do not satisfy")));
}

TEST_F(ReconfiguredTest, AnotherConfigurationInTheAnchorsPlaceIsFound) {
  fabric::SignedChain other;
  other.add("x", &other.orderer_);
  other.add(other.config_of(other.second_), &other.orderer_, 0);
  EXPECT_THAT(texts(audited(chain, {"teleop", other.chain_[2].SerializeAsString()})),
              ElementsAre(HasSubstr("block 2: it is another block than the trust anchor")));
}

TEST_F(ChainAuditTest, AWholeChainOfSomebodyElseIsFoundByTheAnchor) {
  const SignedLedger other;
  EXPECT_FALSE(texts(audited(ledger.chain, other.trust())).empty());
  Trust blind{"teleop", ""};
  EXPECT_THAT(texts(audited(other.chain, blind)), IsEmpty());
  EXPECT_THAT(to_table(audited(other.chain, blind), {"teleop", "memory", ""}), HasSubstr("NO TRUST ANCHOR"));
}

TEST_F(ChainAuditTest, AnAnchorOfAnotherChannelIsRefused) {
  EXPECT_FALSE(ChainAudit::start({"other", ledger.chain[0]}));
  EXPECT_FALSE(ChainAudit::start({"teleop", "no block"}));
}

TEST_F(ChainAuditTest, AnOrderersBlocksHaveNoFlagsAndAreValidatedAllTheSame) {
  for (std::string& bytes : ledger.chain) {
    common::Block block = parsed(bytes);
    block.mutable_metadata()->mutable_metadata(common::TRANSACTIONS_FILTER)->clear();
    bytes = block.SerializeAsString();
  }
  const ChainAudit audit = audited(ledger.chain, ledger.trust());
  EXPECT_THAT(texts(audit), IsEmpty());
  EXPECT_EQ(audit.counts().without_flags, ledger.chain.size());
  EXPECT_EQ(audit.counts().valid, audit.counts().transactions);
}

TEST_F(ChainAuditTest, WhatFailsByWhatItReadIsARefusalAndNoFinding) {
  for (int i = 0; i < 2; ++i) ledger.send(ledger.pilot, "release", SignedLedger::drones_call());
  ledger.commit();
  const ChainAudit audit = audited(ledger.chain, ledger.trust());
  EXPECT_THAT(texts(audit), IsEmpty());
  ASSERT_EQ(audit.report().refusals().size(), 1U);
  const auto& [key, refusals] = *audit.report().refusals().begin();
  EXPECT_EQ(key.code, protos::MVCC_READ_CONFLICT);
  EXPECT_EQ(key.who, "Org2MSP/client.Org2MSP");
  EXPECT_EQ(refusals.count, 1U);
}

}  // namespace
}  // namespace ledgerline::audit
