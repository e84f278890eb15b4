#include "tests/unit/chaincode/endorser/channel.hpp"

#include "common/fabric/tx/envelope.hpp"
#include "common/policies.pb.h"
#include "ledger/rwset/rwset.pb.h"
#include "msp/msp_config.pb.h"
#include "orderer/configuration.pb.h"
#include "peer/lifecycle/chaincode_definition.pb.h"
#include "peer/lifecycle/db.pb.h"
#include "peer/policy.pb.h"
#include "peer/transaction.pb.h"
#include "tests/unit/common/crypto/revocation_list.hpp"

namespace ledgerline::endorser {
namespace {

const std::string fields = "namespaces/fields/ledgerline/";

node::CoreConfig config_of_channel() {
  node::CoreConfig config;
  for (const auto* one : {&people().first, &people().second, &people().third})
    config.organisations.push_back(one->root());
  config.orderers = people().orderers.root();
  return config;
}

std::vector<crypto::SigningIdentity> identities_of(const std::vector<Member>& members) {
  std::vector<crypto::SigningIdentity> all;
  for (const Member& one : members) all.push_back(one.identity);
  return all;
}

/// The embedded node's configuration, as one of Fabric's: ordered by Raft, with a policy for the lifecycle and lists of
/// who is revoked.
std::string config_envelope(const std::vector<std::pair<std::string, std::string>>& revoked) {
  common::Envelope envelope;
  common::Payload payload;
  common::ConfigEnvelope config;
  envelope.ParseFromString(node::make_config_envelope(config_of_channel(), people().orderer.identity));
  payload.ParseFromString(envelope.payload());
  config.ParseFromString(payload.data());
  auto& groups = *config.mutable_config()->mutable_channel_group()->mutable_groups();
  orderer::ConsensusType consensus;
  consensus.set_type("etcdraft");
  (*groups["Orderer"].mutable_values())["ConsensusType"].set_value(consensus.SerializeAsString());
  auto& policies = *groups["Application"].mutable_policies();
  policies["LifecycleEndorsement"] = policies["Endorsement"];
  for (const auto& [msp_id, list] : revoked) {
    common::ConfigValue& value = (*(*groups["Application"].mutable_groups())[msp_id].mutable_values())["MSP"];
    msp::MSPConfig outer;
    msp::FabricMSPConfig inner;
    outer.ParseFromString(value.value());
    inner.ParseFromString(outer.config());
    inner.add_revocation_list(list);
    outer.set_config(inner.SerializeAsString());
    value.set_value(outer.SerializeAsString());
  }
  payload.set_data(config.SerializeAsString());
  envelope.set_payload(payload.SerializeAsString());
  envelope.set_signature(*people().orderer.identity.signer->sign(envelope.payload()));
  return envelope.SerializeAsString();
}

void put_field(kvrwset::KVRWSet& set, const std::string& field, const std::string& bytes) {
  lifecycle::StateData data;
  data.set_bytes(bytes);
  kvrwset::KVWrite& write = *set.add_writes();
  write.set_key(fields + field);
  write.set_value(data.SerializeAsString());
}

}  // namespace

Member issue(const fabric::Organisation& organisation, const std::string& name, const std::string& unit, int days) {
  const auto made =
      crypto::issue(organisation.ca,
                    {.common_name = name, .organization = organisation.msp_id, .unit = unit, .sans = {}, .days = days});
  msp::SerializedIdentity serialized;
  serialized.set_mspid(organisation.msp_id);
  serialized.set_id_bytes(made->certificate_pem);
  return {{{organisation.msp_id, crypto::parse_certificate(made->certificate_pem)->subject},
           serialized.SerializeAsString(),
           *crypto::make_signer(library, made->key_pem)},
          made->certificate_pem};
}

const People& people() {
  static const People all;
  return all;
}

StockPeer::StockPeer()
    : ledger_([](std::uint64_t) -> Result<std::string> { return Error{"no block is asked for"}; }),
      endorser_(config_, node::MemberCheck(crypto::make_msp_registry(library, {}), config_.channel),
                identities_of(people().peers), ledger_) {
  endorser_.answer_as_fabric(
      [this] { return approves() && definition_.sequence ? std::optional(definition_) : std::nullopt; });
}

std::vector<int> StockPeer::take(common::Block& block) {
  const std::uint64_t number = block.header().number();
  if (const auto config = fabric::read_channel_config(block)) {
    members_ = crypto::make_msp_registry(library, fabric::everybody(*config));
    key_state_.configure(*config);
    endorser_.set_members(
        node::MemberCheck(crypto::make_msp_registry(library, config->organisations), config_.channel));
  }
  const auto verdicts = validate_transactions(block, key_state_, *members_, {});
  key_state_.apply(number, verdicts);
  std::vector<int> codes;
  std::string flags;
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    codes.push_back(verdicts[i].code);
    flags += static_cast<char>(verdicts[i].code);
    ledger_.state().add_tx(verdicts[i].tx_id, {number, verdicts[i].code});
    if (verdicts[i].code != protos::VALID) continue;
    ledger_.state().write(node::set_of(verdicts[i].sets, config_.contract), {number, i});
    const kvrwset::KVRWSet defined = node::set_of(verdicts[i].sets, fabric::lifecycle_name);
    for (const kvrwset::KVWrite& write : defined.writes()) {
      if (write.key() != fields + "EndorsementInfo") continue;
      lifecycle::StateData data;
      lifecycle::ChaincodeEndorsementInfo info;
      data.ParseFromString(write.value());
      info.ParseFromString(data.bytes());
      definition_ = {info.version(), node::Version{number, i}};
    }
  }
  block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, flags);
  ledger_.add_block(fabric::header_hash(block.header()));
  return codes;
}

Channel::Channel() {
  configure();
  define();
  peer.approve();
}

std::vector<int> Channel::add(const std::vector<std::string>& envelopes, bool config) {
  common::Block block = node::make_block(peer.end(), envelopes);
  if (config) last_config_ = block.header().number();
  fabric::SignedChain::sign(block, people().orderer.identity, last_config_);
  codes.push_back(peer.take(block));
  blocks.push_back(block.SerializeAsString());
  return codes.back();
}

std::vector<int> Channel::cut(const std::vector<std::string>& envelopes) { return add(envelopes, false); }

void Channel::configure() { add({config_envelope(revoked_)}, true); }

void Channel::revoke(const fabric::Organisation& organisation, const Member& member) {
  revoked_.emplace_back(organisation.msp_id, crypto::list_of(organisation.ca, member.certificate_pem));
  configure();
}

void Channel::define() {
  lifecycle::ChaincodeEndorsementInfo info;
  info.set_version("1." + std::to_string(++version));
  protos::ApplicationPolicy policy;
  policy.set_channel_config_policy_reference("/Channel/Application/Endorsement");
  lifecycle::ChaincodeValidationInfo validation;
  validation.set_validation_plugin("vscc");
  validation.set_validation_parameter(policy.SerializeAsString());
  kvrwset::KVRWSet set;
  put_field(set, "Sequence", std::to_string(version));
  put_field(set, "EndorsementInfo", info.SerializeAsString());
  put_field(set, "ValidationInfo", validation.SerializeAsString());

  fabric::Draft draft;
  draft.creator = &people().admin.identity;
  draft.endorsers = {&people().peers[0].identity, &people().peers[1].identity};
  draft.channel_header.set_type(common::ENDORSER_TRANSACTION);
  draft.channel_header.set_channel_id("teleop");
  draft.extension.mutable_chaincode_id()->set_name(fabric::lifecycle_name);
  draft.action.mutable_chaincode_id()->set_name(fabric::lifecycle_name);
  draft.action.mutable_chaincode_id()->set_version("syscc");
  draft.nonce = "definition " + std::to_string(++drafts_);
  draft.on_results = [&](std::string& results) {
    rwset::TxReadWriteSet all;
    rwset::NsReadWriteSet& own = *all.add_ns_rwset();
    own.set_namespace_(fabric::lifecycle_name);
    own.set_rwset(set.SerializeAsString());
    results = all.SerializeAsString();
  };
  EXPECT_EQ(cut({draft.seal()}), std::vector<int>{protos::VALID});
}

std::string Channel::other_block(std::uint64_t number, const std::string& previous_hash, const Member& orderer) const {
  common::Block real;
  real.ParseFromString(blocks.at(number));
  const std::vector<std::string> none{"an envelope of another chain"};
  common::Block block = node::make_block({number, previous_hash}, none);
  common::OrdererBlockMetadata value;
  common::Metadata metadata;
  metadata.ParseFromString(real.metadata().metadata(common::SIGNATURES));
  value.ParseFromString(metadata.value());
  fabric::SignedChain::sign(block, orderer.identity, value.last_config().index());
  block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, std::string(1, '\x02'));
  return block.SerializeAsString();
}

}  // namespace ledgerline::endorser
