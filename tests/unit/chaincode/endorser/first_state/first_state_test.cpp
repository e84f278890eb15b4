#include "chaincode/endorser/core/peer_snapshot.hpp"

#include <gmock/gmock.h>

#include "chaincode/endorser/core/peer_follower.hpp"
#include "common/configtx.pb.h"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "ledgerline.pb.h"
#include "peer/proposal_response.pb.h"
#include "tests/unit/chaincode/endorser/first_state/followed_channel.hpp"

namespace ledgerline::endorser {
namespace {

using node::Code;
using node::Reply;
using ::testing::HasSubstr;

class FirstStateTest : public FollowedChannel {
 protected:
  Comparison beside_the_peer(EndorserCore& one, const fabric::Proposal& proposal) {
    const Reply own = one.process_proposal(proposal.signed_proposal, now),
                peers = channel.peer.process_proposal(proposal.signed_proposal, now);
    EXPECT_EQ(own.code, peers.code) << own.message << " | " << peers.message;
    if (own.code == Code::ok) return compare_answers(own.bytes, peers.bytes);
    return own.message == peers.message ? Comparison::same : Comparison::differ;
  }
  std::string refused(const PeerSnapshotFiles& files, std::string_view hash = {}) {
    const auto begun = begin(files, hash);
    return begun ? "it begins" : begun.error().message;
  }
  /// The snapshot with another text in its values, and with the right hashes.
  PeerSnapshotFiles forge(const std::string& from, const std::string& to) const {
    Snapshot changed = known();
    node::State::Parts parts = changed.contract.parts();
    for (auto& [key, value] : parts.values)
      if (const auto at = value.bytes.find(from); at != std::string::npos) value.bytes.replace(at, from.size(), to);
    changed.contract = node::State(std::move(parts));
    return snapshot_of(changed);
  }
};

TEST_F(FirstStateTest, AnswersAsThePeerAndGoesOnByItsBlocks) {
  const fabric::Proposal used = commit(steady_holder, calls.command());
  follow(core);
  auto begun = begin(snapshot_of(known()));
  ASSERT_TRUE(begun.ok()) << begun.error().message;
  EndorserCore& own = **begun;
  EXPECT_EQ(own.height(), channel.blocks.size());
  EXPECT_EQ(own.defined_at(), core.defined_at());
  EXPECT_EQ(beside_the_peer(own, used), Comparison::same) << "an id of before the snapshot is used up";
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(beside_the_peer(own, propose(steady_holder, calls.command())), Comparison::same);
    EXPECT_EQ(beside_the_peer(own, propose(steady_host, calls.state())), Comparison::same);
    commit(steady_holder, calls.command());
    if (i % 5 == 0) {
      channel.define();
      channel.peer.approve();
    }
    follow(own);
  }
  // It begins again from what it has kept by then.
  EndorserCore again(setup());
  ASSERT_TRUE(again.restore(own.snapshot()).ok());
  EXPECT_EQ(beside_the_peer(again, propose(steady_holder, calls.command())), Comparison::same);
}

TEST_F(FirstStateTest, WhatIsInOldBlocksIsForAPeerToAnswer) {
  const auto state = calls.state();
  commit(steady_host, state);
  follow(core);
  auto begun = begin(snapshot_of(known()));
  ASSERT_TRUE(begun.ok()) << begun.error().message;
  commit(steady_host, state);
  follow(**begun);
  EndorserCore again(setup());
  ASSERT_TRUE(again.restore((*begun)->snapshot()).ok());
  // The second was never there, or was deleted before the snapshot: who has not read the blocks cannot say.
  for (const char* id : {"tello9/a", "tello9/of-which-nobody-has-heard"}) {
    const auto proposal = propose(steady_host, {"history", {id}});
    EXPECT_EQ((*begun)->process_proposal(proposal.signed_proposal, now).code, Code::unavailable) << id;
    EXPECT_EQ(again.process_proposal(proposal.signed_proposal, now).code, Code::unavailable) << id;
  }
}

TEST_F(FirstStateTest, WithoutItsHashAChangedValueWouldBeEndorsed) {
  SetCall call;
  call.add_assets()->set_id("tello9/a");
  call.mutable_assets(0)->set_msg_type("t");
  call.mutable_assets(0)->set_msg_data("honest data");
  commit(steady_host, {"set", {call.SerializeAsString()}});
  follow(core);
  QueryCall question;
  question.set_id("tello9/a");
  const auto proposal = propose(steady_host, {"get", {question.SerializeAsString()}});
  const auto endorsed = [&](EndorserCore& one) {
    protos::ProposalResponse response;
    response.ParseFromString(one.process_proposal(proposal.signed_proposal, now).bytes);
    return response.has_endorsement() ? response.response().payload() : "";
  };
  EXPECT_THAT(endorsed(core), HasSubstr("honest data"));

  const PeerSnapshotFiles honest = snapshot_of(known()), forged = forge("honest data", "forged data");
  PeerSnapshotFiles changed = honest;
  changed.states = forged.states;
  EXPECT_THAT(refused(changed), HasSubstr("public_state.data: its SHA-256 is not"));
  // Who may write the whole folder writes the hashes, too.
  const auto begun = begin(forged);
  ASSERT_TRUE(begun.ok()) << begun.error().message;
  EXPECT_THAT(endorsed(**begun), HasSubstr("forged data"));
  // Then what another organisation's peer has stops it.
  const std::string hash = crypto::hex(crypto::sha256(honest.description));
  EXPECT_THAT(refused(forged, hash), HasSubstr("it is another snapshot"));
  EXPECT_EQ(refused(honest, hash), "it begins");
}

TEST_F(FirstStateTest, TheNextBlockMustFollowItsNewest) {
  auto begun = begin(snapshot_of(known()));
  ASSERT_TRUE(begun.ok()) << begun.error().message;
  const std::string other = channel.other_block(channel.blocks.size() - 1, std::string(32, 'x'), people().orderer);
  common::Block block;
  block.ParseFromString(other);
  block.mutable_header()->set_number(channel.blocks.size());
  const std::string raw = block.SerializeAsString();
  EXPECT_THAT((*begun)->apply(*fabric::decode_block(raw), raw).error().message, HasSubstr("of another chain"));
}

TEST_F(FirstStateTest, OneOfAnotherChainIsRefused) {
  PeerSnapshotFiles files = snapshot_of(known());
  seal(files, {known().end.height, std::string(32, 'x')});
  EXPECT_THAT(refused(files), HasSubstr("it is of another chain"));
  seal(files, {known().end.height + 1, known().end.hash});
  EXPECT_THAT(refused(files), HasSubstr("there is no block")) << "the peer does not have it yet";
}

TEST_F(FirstStateTest, AChainThatTheOrderersHaveNotSignedIsRefused) {
  const auto said = read_peer_snapshot(snapshot_of(known()), {}, {});
  ASSERT_TRUE(said.ok());
  // As by a peer that makes up a chain, and a snapshot of it.
  PeerSnapshot forged = *said;
  const std::uint64_t last = forged.end.height - 1;
  common::Block block;
  block.ParseFromString(channel.other_block(last, std::string(32, 'x'), people().forger));
  forged.end.hash = fabric::header_hash(block.header());
  fabric::BlockValidator anchored = make_validator();
  const auto config = verify_snapshot(forged, anchored, [&](std::uint64_t number) -> Result<common::Block> {
    return number == last ? Result<common::Block>(block) : fetch(number);
  });
  ASSERT_FALSE(config.ok());
  EXPECT_THAT(config.error().message, HasSubstr("signatures do not satisfy"));
}

TEST_F(FirstStateTest, TheConfigurationIsTheChainsOwn) {
  channel.revoke(people().first, people().hosts[2]);
  commit(steady_holder, calls.command());
  follow(core);
  const PeerSnapshotFiles newest = snapshot_of(known());
  EXPECT_TRUE(begin(newest).ok()) << refused(newest);
  const auto said = read_peer_snapshot(newest, {}, {});
  ASSERT_TRUE(said.ok());
  EXPECT_GT(said->config_block, 0U);
  // One who lets the revoked back in, or somebody else.
  Snapshot older = known();
  older.config_block = channel.blocks[0];
  EXPECT_THAT(refused(snapshot_of(older)), HasSubstr("its configuration, of block 0, is not the channel's, of block"));
  PeerSnapshot changed = *said;
  common::ConfigEnvelope config;
  config.ParseFromString(changed.config);
  config.mutable_config()->set_sequence(77);
  changed.config = config.SerializeAsString();
  fabric::BlockValidator anchored = make_validator();
  EXPECT_FALSE(verify_snapshot(changed, anchored, [this](std::uint64_t number) { return fetch(number); }).ok());
}

TEST_F(FirstStateTest, OneOlderThanTheTrustAnchorIsRefused) {
  const auto said = read_peer_snapshot(snapshot_of(known()), {}, {});
  ASSERT_TRUE(said.ok());
  channel.revoke(people().first, people().hosts[2]);
  fabric::BlockValidator anchored = make_validator(channel.blocks.size() - 1);
  const auto config = verify_snapshot(*said, anchored, [this](std::uint64_t number) { return fetch(number); });
  ASSERT_FALSE(config.ok());
  EXPECT_THAT(config.error().message, HasSubstr("is older than config_block"));
}

}  // namespace
}  // namespace ledgerline::endorser
