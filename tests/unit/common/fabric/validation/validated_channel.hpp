#pragma once
#include <gtest/gtest.h>

#include <algorithm>

#include "common/fabric/validation/transaction_validator.hpp"
#include "common/policies.pb.h"
#include "tests/unit/common/fabric/validation/drafts.hpp"
#include "tests/unit/common/fabric/validation/signed_chain.hpp"

/// A channel of three organisations that is followed from its first block on, for tests of those who validate its
/// transactions.
namespace ledgerline::fabric {

class ValidatedChannel {
 protected:
  ValidatedChannel() {
    node::CoreConfig config;
    for (const Organisation* one : {&first_, &second_, &third_}) config.organisations.push_back(one->root());
    config.orderers = orderers_.root();
    first_block_ = node::make_block({}, {node::make_config_envelope(config, orderer_)});
    config_ = *read_channel_config(first_block_);
    members_ = crypto::make_msp_registry(library, config_.organisations);
    state_.configure(config_);
    state_.define("ledgerline");
    for (const Organisation* one : {&first_, &second_, &third_}) {
      cast_.members.push_back(one->member("client"));
      cast_.peers.push_back(one->member("peer"));
      cast_.new_peers.push_back(one->member("peer"));
    }
    cast_.admin = first_.member("admin");
    cast_.client = first_.member("client");
    cast_.nobodys = Organisation("Org1MSP").member("peer");
    all_ = kinds(cast_, state_, random_);
    fill();
  }

  Draft draft() {
    Draft draft;
    draft.creator = &cast_.members[0];
    draft.endorsers = {&cast_.peers[0], &cast_.peers[1]};
    draft.channel_header.set_type(common::ENDORSER_TRANSACTION);
    draft.channel_header.set_channel_id("teleop");
    draft.extension.mutable_chaincode_id()->set_name("ledgerline");
    draft.action.mutable_chaincode_id()->set_name("ledgerline");
    draft.action.mutable_chaincode_id()->set_version("1");
    draft.nonce = "nonce " + std::to_string(++nonces_);
    return draft;
  }
  void write(Draft& draft, const std::string& key) {
    draft.set.add_writes()->set_key(key);
    draft.set.mutable_writes()->rbegin()->set_value("value");
  }
  /// All keys that kinds speak of are there; the own ones are Org1MSP's.
  Draft filling() {
    Draft made = draft();
    for (int i = 0; i < 20; ++i) {
      write(made, "draft/free/" + std::to_string(i));
      if (i < 9) write(made, "draft/range/" + std::to_string(i));
      const std::string own = "draft/own/" + std::to_string(i);
      write(made, own);
      kvrwset::KVMetadataWrite& metadata = *made.set.add_metadata_writes();
      metadata.set_key(own);
      metadata.add_entries()->set_name(validation_parameter);
      metadata.mutable_entries(0)->set_value(peer_policy("Org1MSP"));
    }
    return made;
  }
  void fill() { ASSERT_EQ(commit({filling().seal()}), std::vector<int>{protos::VALID}); }
  std::vector<TransactionVerdict> validate(const std::vector<std::string>& envelopes, ValidationRules rules = {}) {
    common::Block block;
    for (const std::string& one : envelopes) block.mutable_data()->add_data(one);
    return validate_transactions(block, state_, *members_, rules);
  }
  std::vector<int> commit(const std::vector<std::string>& envelopes) {
    const auto verdicts = validate(envelopes);
    state_.apply(++height_, verdicts);
    std::vector<int> codes;
    for (const TransactionVerdict& one : verdicts) codes.push_back(one.code);
    return codes;
  }
  const Kind& kind(const std::string& name) {
    return *std::find_if(all_.begin(), all_.end(), [&](const Kind& one) { return one.name == name; });
  }
  std::string sealed(const std::string& name) {
    Draft made = draft();
    kind(name).bend(made);
    return made.seal();
  }

  const Organisation first_{"Org1MSP"}, second_{"Org2MSP"}, third_{"Org3MSP"}, orderers_{"OrdererMSP"};
  const crypto::SigningIdentity orderer_ = orderers_.member("orderer");
  Cast cast_;
  common::Block first_block_;
  Random random_{1};
  ChannelConfig config_;
  std::unique_ptr<crypto::MspRegistry> members_;
  KeyState state_;
  std::vector<Kind> all_;
  std::uint64_t height_ = 0;
  int nonces_ = 0;
};

}  // namespace ledgerline::fabric
