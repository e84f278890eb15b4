// Random proposals, with good ones, used ids, wrong and expired creators in fixed shares, asked of the endorser and of
// a stock peer of the same blocks: 1,000 in every run, 10,000 with LEDGERLINE_LONG=1. tests/system/endorser asks a peer
// of Fabric.
#include <gtest/gtest.h>

#include <map>

#include "chaincode/endorser/core/endorser_core.hpp"
#include "chaincode/endorser/core/peer_follower.hpp"
#include "chaincode/endorser/core/peer_snapshot.hpp"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"
#include "tests/unit/campaign.hpp"
#include "tests/unit/chaincode/endorser/channel.hpp"
#include "tests/unit/chaincode/endorser/first_state/snapshots_of_tests.hpp"
#include "tests/unit/chaincode/endorser/random_calls.hpp"

namespace ledgerline::endorser {
namespace {

using node::Code;
using node::Reply;

constexpr TimeNs two_days_ns = 2 * 86'400 * ns_per_s;

struct Tally {
  int asked = 0, endorsed = 0, refused = 0, unanswered = 0, left_to_the_peer = 0;
};

std::vector<crypto::IdentityName> names_of(const std::vector<Member>& members) {
  std::vector<crypto::IdentityName> names;
  for (const Member& one : members) names.push_back(one.identity.name);
  return names;
}

class RandomProposals : public ::testing::Test {
 protected:
  RandomProposals() {
    for (const CallOf& one : steady_calls(names_)) commit(one, true);
    follow();
  }

  fabric::Proposal propose(const crypto::SigningIdentity& who, const fabric::Call& call, std::string nonce = {}) {
    if (nonce.empty()) {
      nonce = "nonce " + std::to_string(++nonces_);
      nonce.resize(24, '.');
      last_nonce_ = nonce;
    }
    return *fabric::make_proposal(who, {}, call, now_.real_ns, nonce);
  }

  void follow() {
    for (; core_->height() < channel_.blocks.size();) {
      const std::string& raw = channel_.blocks[core_->height()];
      const Status taken = core_->apply(*fabric::decode_block(raw), raw);
      ASSERT_TRUE(taken.ok()) << taken.error().message;
    }
  }
  static std::unique_ptr<EndorserCore> make_core() {
    return std::make_unique<EndorserCore>(
        EndorserCore::Setup{{}, people().endorsers[0].identity, fabric::BlockValidator::registry_of(library)});
  }
  /// With what the peer's snapshot of now says, in place of all blocks.
  void restart() {
    const auto said = read_peer_snapshot(snapshot_of(*read_snapshot(core_->snapshot())), {}, {});
    ASSERT_TRUE(said.ok()) << said.error().message;
    auto validator = fabric::BlockValidator::from(channel_.blocks[0], "teleop", library);
    const auto config = verify_snapshot(*said, *validator, [this](std::uint64_t number) {
      common::Block block;
      block.ParseFromString(channel_.blocks.at(number));
      return block;
    });
    ASSERT_TRUE(config.ok()) << config.error().message;
    core_ = make_core();
    ASSERT_TRUE(core_->restore({said->end, *config, said->contract, said->lifecycle}).ok());
  }
  /// By all three organisations' peers; what they refuse is not ordered.
  void order(const crypto::SigningIdentity& who, const fabric::Proposal& proposal, bool must) {
    const Reply reply = channel_.peer.endorse(proposal.signed_proposal, now_);
    ASSERT_TRUE(reply.code == Code::ok || !must) << reply.detail;
    if (reply.code != Code::ok) return;
    ASSERT_EQ(channel_.cut({*fabric::sign_envelope(who, reply.bytes)}), std::vector<int>{protos::VALID});
    used_.emplace_back(&who, last_nonce_);
  }
  void commit(const CallOf& one, bool must) {
    const crypto::SigningIdentity& who = members_[one.who].identity;
    order(who, propose(who, one.call), must);
  }

  /// Both are asked; false: they do not say the same.
  void ask_both(const fabric::Proposal& proposal, const std::string& function, Tally& tally) {
    ++tally.asked;
    const Reply own = core_->process_proposal(proposal.signed_proposal, now_);
    if (own.code == Code::unavailable) {
      ++tally.left_to_the_peer;
      EXPECT_TRUE(function == "get" || function == "verify") << function << " looks into no old block: " << own.message;
      return;
    }
    const Reply peers = channel_.peer.process_proposal(proposal.signed_proposal, now_);
    ASSERT_EQ(own.code, peers.code) << own.message << " | " << peers.message;
    if (own.code != Code::ok) {
      ++tally.unanswered;
      ASSERT_EQ(own.message, peers.message);
      return;
    }
    ASSERT_EQ(compare_answers(own.bytes, peers.bytes), Comparison::same) << function;
    protos::ProposalResponse response;
    ASSERT_TRUE(response.ParseFromString(own.bytes));
    ++(response.has_endorsement() ? tally.endorsed : tally.refused);
  }

  void ask_one(Kind kind) {
    Tally& tally = tallies_[kind];
    const crypto::SigningIdentity* who = &members_[calls_.pick(3) == 0 ? calls_.pick(people_count) : host].identity;
    fabric::Call call = calls_.any();
    std::string nonce;
    switch (kind) {
      case Kind::command:
        call = calls_.command();
        who = &members_[steady_holder].identity;
        break;
      case Kind::state:
        call = calls_.state();
        who = &members_[steady_host].identity;
        break;
      case Kind::any:
        break;
      case Kind::used_id:
        std::tie(who, nonce) = used_[calls_.pick(used_.size())];
        break;
      case Kind::wrong_creator:
        call = calls_.state();
        who = &wrong_[calls_.pick(wrong_.size())];
        break;
      case Kind::expired_creator:
        call = calls_.state();
        who = &people().expired.identity;
        break;
    }
    const fabric::Proposal proposal = propose(*who, call, nonce);
    const int endorsed = tally.endorsed;
    ask_both(proposal, call.function, tally);
    if (tally.endorsed == endorsed || calls_.pick(4) != 0 || call.function == "get" || call.function == "verify")
      return;
    order(*who, proposal, true);
    follow();
  }

  void ask_many(int count) {
    for (int i = 0; i < count && !HasFatalFailure(); ++i) {
      if (i % 50 == 0) {
        for (const CallOf& one : usual_calls(names_)) commit(one, false);
        follow();
      }
      ask_one(calls_.next_kind());
    }
  }

  /// Of more than one organisation, in the order of Who.
  const std::vector<Member> members_{people().hosts[0],
                                     people().admin,
                                     issue(people().second, "Admin", "admin"),
                                     people().foreigner,
                                     issue(people().second, "holder", "client"),
                                     people().hosts[1]};
  const std::vector<crypto::SigningIdentity> wrong_ =
      wrong_creators(members_[steady_host].identity, members_[host].identity);
  const std::vector<crypto::IdentityName> names_ = names_of(members_);
  node::Now now_{ns_per_s, realtime_ns() + two_days_ns};  // behind the end of the one that expires
  Channel channel_;
  std::unique_ptr<EndorserCore> core_ = make_core();
  int nonces_ = 0;
  std::string last_nonce_;
  std::vector<std::pair<const crypto::SigningIdentity*, std::string>> used_;
  Calls calls_{7, names_};
  std::map<Kind, Tally> tallies_;
};

TEST_F(RandomProposals, AreAnsweredAsByThePeer) {
  const int count = slow ? 200 : seeds(1'000, 10'000);
  ask_many(count);
  for (const Share& share : shares) {
    const Tally& tally = tallies_[share.kind];
    std::printf("%s: %d asked, %d endorsed, %d refused, %d unanswered, %d left to the peer\n", share.name, tally.asked,
                tally.endorsed, tally.refused, tally.unanswered, tally.left_to_the_peer);
    EXPECT_EQ(tally.asked, count / 20 * share.of_twenty) << share.name;
  }
  EXPECT_GE(tallies_[Kind::command].endorsed, count / 5) << "good commands";
  EXPECT_EQ(tallies_[Kind::state].endorsed, tallies_[Kind::state].asked);
  EXPECT_GE(tallies_[Kind::any].refused, count / 10);
  EXPECT_GE(tallies_[Kind::any].endorsed, count / 50);
  for (const Kind kind : {Kind::used_id, Kind::wrong_creator, Kind::expired_creator})
    EXPECT_EQ(tallies_[kind].unanswered, tallies_[kind].asked) << name_of(kind);
  EXPECT_EQ(tallies_[Kind::command].left_to_the_peer + tallies_[Kind::state].left_to_the_peer, 0);
}

TEST_F(RandomProposals, BehindAPeersSnapshotAreAnsweredAsByThePeer) {
  const int count = slow ? 60 : seeds(200, 2'000);
  for (int snapshots = 0; snapshots < 3 && !HasFatalFailure(); ++snapshots) {
    ask_many(count);
    restart();
  }
  ask_many(count);
  EXPECT_GT(tallies_[Kind::command].endorsed, 0);
  EXPECT_EQ(tallies_[Kind::used_id].unanswered, tallies_[Kind::used_id].asked) << "of before the snapshot, too";
}

}  // namespace
}  // namespace ledgerline::endorser
