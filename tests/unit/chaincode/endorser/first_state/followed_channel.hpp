#pragma once
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "chaincode/endorser/core/endorser_core.hpp"
#include "chaincode/endorser/core/peer_snapshot.hpp"
#include "peer/transaction.pb.h"
#include "tests/unit/chaincode/endorser/channel.hpp"
#include "tests/unit/chaincode/endorser/first_state/snapshots_of_tests.hpp"
#include "tests/unit/chaincode/endorser/random_calls.hpp"

namespace ledgerline::endorser {

/// A channel of Fabric's with a drone that is enrolled and flown, and an endorser that has read all of its blocks.
class FollowedChannel : public ::testing::Test {
 protected:
  FollowedChannel() {
    for (const CallOf& one : steady_calls(names_of(members))) commit(one.who, one.call);
    follow(core);
  }
  static std::vector<crypto::IdentityName> names_of(const std::vector<Member>& members) {
    std::vector<crypto::IdentityName> names;
    for (const Member& one : members) names.push_back(one.identity.name);
    return names;
  }

  fabric::Proposal propose(Who who, const fabric::Call& call) {
    std::string nonce = "nonce " + std::to_string(++nonces_);
    nonce.resize(24, '.');
    return *fabric::make_proposal(members[who].identity, {}, call, now.real_ns, nonce);
  }
  /// Endorsed by all peers; what was proposed.
  fabric::Proposal commit(Who who, const fabric::Call& call) {
    fabric::Proposal proposal = propose(who, call);
    const node::Reply reply = channel.peer.endorse(proposal.signed_proposal, now);
    EXPECT_EQ(reply.code, node::Code::ok) << reply.detail;
    EXPECT_EQ(channel.cut({*fabric::sign_envelope(members[who].identity, reply.bytes)}),
              std::vector<int>{protos::VALID});
    return proposal;
  }
  void follow(EndorserCore& one) {
    while (one.height() < channel.blocks.size()) {
      const std::string& raw = channel.blocks[one.height()];
      const Status taken = one.apply(*fabric::decode_block(raw), raw);
      ASSERT_TRUE(taken.ok()) << taken.error().message;
    }
  }

  EndorserCore::Setup setup() const {
    return {{}, people().endorsers[0].identity, fabric::BlockValidator::registry_of(library)};
  }
  Snapshot known() const { return *read_snapshot(core.snapshot()); }
  fabric::BlockValidator make_validator(std::size_t anchor = 0) const {
    return *fabric::BlockValidator::from(channel.blocks.at(anchor), "teleop", library);
  }
  Result<common::Block> fetch(std::uint64_t number) const {
    common::Block block;
    if (number >= channel.blocks.size()) return Error{"there is no block " + std::to_string(number)};
    block.ParseFromString(channel.blocks[number]);
    return block;
  }
  /// One that begins with the snapshot, where the chain is its.
  Result<std::unique_ptr<EndorserCore>> begin(const PeerSnapshotFiles& files, std::string_view hash = {}) const {
    const auto said = read_peer_snapshot(files, {}, hash);
    if (!said) return said.error();
    fabric::BlockValidator anchored = make_validator();
    const auto config = verify_snapshot(*said, anchored, [this](std::uint64_t number) { return fetch(number); });
    if (!config) return config.error();
    auto begun = std::make_unique<EndorserCore>(setup());
    const Status restored = begun->restore({said->end, *config, said->contract, said->lifecycle});
    if (!restored) return restored.error();
    return begun;
  }

  const std::vector<Member> members{people().hosts[0],
                                    people().admin,
                                    issue(people().second, "Admin", "admin"),
                                    people().foreigner,
                                    issue(people().second, "holder", "client"),
                                    people().hosts[1]};
  node::Now now{ns_per_s, realtime_ns()};
  Channel channel;
  EndorserCore core{setup()};
  Calls calls{5, names_of(members)};

 private:
  int nonces_ = 0;
};

}  // namespace ledgerline::endorser
