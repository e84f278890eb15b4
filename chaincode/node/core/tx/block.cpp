#include "chaincode/node/core/tx/messages.hpp"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include "common/base/check.hpp"
#include "common/configtx.pb.h"
#include "common/configuration.pb.h"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/policy.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/policies.pb.h"
#include "msp/msp_config.pb.h"
#include "orderer/configuration.pb.h"

namespace ledgerline::node {
namespace {

/// Maps in protobuf have no order of their own; the config block needs one, since it is hashed.
std::string serialize(const google::protobuf::MessageLite& message) {
  std::string bytes;
  google::protobuf::io::StringOutputStream stream(&bytes);
  google::protobuf::io::CodedOutputStream out(&stream);
  out.SetSerializationDeterministic(true);
  message.SerializeToCodedStream(&out);
  out.Trim();
  return bytes;
}

void set_value(common::ConfigGroup& group, const std::string& name, const google::protobuf::MessageLite& value) {
  common::ConfigValue& entry = (*group.mutable_values())[name];
  entry.set_value(serialize(value));
  entry.set_mod_policy("Admins");
}

void set_capability(common::ConfigGroup& group) {
  common::Capabilities capabilities;
  (*capabilities.mutable_capabilities())["V2_0"];
  set_value(group, "Capabilities", capabilities);
}

msp::MSPConfig msp_config(const crypto::MspRoot& organisation) {
  msp::FabricMSPConfig fabric;
  fabric.set_name(organisation.msp_id);
  fabric.add_root_certs(organisation.ca_pem);
  fabric.mutable_crypto_config()->set_signature_hash_family("SHA2");
  fabric.mutable_crypto_config()->set_identity_identifier_hash_function("SHA256");
  msp::FabricNodeOUs& units = *fabric.mutable_fabric_node_ous();
  units.set_enable(true);
  units.mutable_client_ou_identifier()->set_organizational_unit_identifier("client");
  units.mutable_peer_ou_identifier()->set_organizational_unit_identifier("peer");
  units.mutable_admin_ou_identifier()->set_organizational_unit_identifier("admin");
  units.mutable_orderer_ou_identifier()->set_organizational_unit_identifier("orderer");
  msp::MSPConfig config;
  config.set_config(fabric.SerializeAsString());
  return config;
}

void set_policy(common::ConfigGroup& group, const std::string& name, int type, const std::string& value) {
  common::ConfigPolicy& entry = (*group.mutable_policies())[name];
  entry.mutable_policy()->set_type(type);
  entry.mutable_policy()->set_value(value);
  entry.set_mod_policy("Admins");
}

/// A policy of which `rule` says how many of the organisations' policies `of` must hold.
void set_policy(common::ConfigGroup& group, const std::string& name, common::ImplicitMetaPolicy::Rule rule,
                const std::string& of) {
  common::ImplicitMetaPolicy policy;
  policy.set_sub_policy(of);
  policy.set_rule(rule);
  set_policy(group, name, common::Policy::IMPLICIT_META, policy.SerializeAsString());
}

/// Its certificates, and who in it may do what `name` is for.
void add_organisation(common::ConfigGroup& to, const crypto::MspRoot& organisation, const std::string& name,
                      const std::string& policy) {
  common::ConfigGroup& group = (*to.mutable_groups())[organisation.msp_id];
  set_value(group, "MSP", msp_config(organisation));
  set_policy(group, name, common::Policy::SIGNATURE, policy);
}

}  // namespace

common::Block make_block(const ChainEnd& end, const std::vector<std::string>& envelopes) {
  common::Block block;
  for (const std::string& envelope : envelopes) block.mutable_data()->add_data(envelope);
  common::BlockHeader& header = *block.mutable_header();
  header.set_number(end.height);
  header.set_previous_hash(end.hash);
  header.set_data_hash(fabric::data_hash(block.data()));
  for (int i = 0; i <= common::COMMIT_HASH; ++i) block.mutable_metadata()->add_metadata();
  return block;
}

Status sign_block(common::Block& block, const crypto::SigningIdentity& orderer) {
  LEDGERLINE_CHECK(block.metadata().metadata_size() > common::SIGNATURES, "a block has room for its signatures",
                   block.header().number());
  common::OrdererBlockMetadata orderer_metadata;
  orderer_metadata.mutable_last_config()->set_index(0);
  common::Metadata signatures;
  signatures.set_value(orderer_metadata.SerializeAsString());
  const std::string header =
      fabric::block_header_bytes(block.header().number(), block.header().previous_hash(), block.header().data_hash());
  common::SignatureHeader signer;
  signer.set_creator(orderer.serialized);
  // A nonce has to differ from block to block and to repeat with the same input; the header's hash does both.
  signer.set_nonce(fabric::header_hash(block.header()).substr(0, 24));
  common::MetadataSignature& signature = *signatures.add_signatures();
  signature.set_signature_header(signer.SerializeAsString());
  auto bytes = orderer.signer->sign(signatures.value() + signature.signature_header() + header);
  if (!bytes) return bytes.error();
  signature.set_signature(*bytes);
  block.mutable_metadata()->set_metadata(common::SIGNATURES, signatures.SerializeAsString());
  return done;
}

std::string make_config_envelope(const CoreConfig& config, const crypto::SigningIdentity& orderer) {
  common::ConfigEnvelope config_envelope;
  common::ConfigGroup& root = *config_envelope.mutable_config()->mutable_channel_group();
  common::HashingAlgorithm hashing;
  hashing.set_name("SHA256");
  set_value(root, "HashingAlgorithm", hashing);
  common::BlockDataHashingStructure structure;
  structure.set_width(0xffffffff);
  set_value(root, "BlockDataHashingStructure", structure);
  set_capability(root);

  common::ConfigGroup& application = (*root.mutable_groups())["Application"];
  set_capability(application);
  for (const crypto::MspRoot& organisation : config.organisations)
    add_organisation(application, organisation, "Endorsement", fabric::peer_policy(organisation.msp_id));
  set_policy(application, "Endorsement", common::ImplicitMetaPolicy::MAJORITY, "Endorsement");
  common::ConfigGroup& ordering = (*root.mutable_groups())["Orderer"];
  set_capability(ordering);
  if (!config.orderers.msp_id.empty()) {
    // Any member of the orderers' organisation signs blocks, as in Fabric's own sample configuration.
    add_organisation(ordering, config.orderers, "Writers", fabric::member_policy(config.orderers.msp_id));
    set_policy(ordering, "BlockValidation", common::ImplicitMetaPolicy::ANY, "Writers");
  }
  orderer::ConsensusType consensus;
  consensus.set_type("ledgerline-node");
  set_value(ordering, "ConsensusType", consensus);
  orderer::BatchSize size;
  size.set_max_message_count(static_cast<std::uint32_t>(config.batch_count));
  size.set_absolute_max_bytes(static_cast<std::uint32_t>(config.max_envelope_bytes));
  size.set_preferred_max_bytes(static_cast<std::uint32_t>(config.batch_bytes));
  set_value(ordering, "BatchSize", size);
  orderer::BatchTimeout timeout;
  timeout.set_timeout(std::to_string(config.batch_timeout_ns / ns_per_us) + "us");
  set_value(ordering, "BatchTimeout", timeout);

  common::SignatureHeader signature_header;
  signature_header.set_creator(orderer.serialized);
  signature_header.set_nonce(std::string(24, '\0'));
  common::ChannelHeader channel_header;
  channel_header.set_type(common::CONFIG);
  channel_header.set_channel_id(config.channel);
  channel_header.set_tx_id(crypto::hex(crypto::sha256(signature_header.nonce() + signature_header.creator())));
  common::Payload payload;
  payload.mutable_header()->set_channel_header(channel_header.SerializeAsString());
  payload.mutable_header()->set_signature_header(signature_header.SerializeAsString());
  payload.set_data(serialize(config_envelope));
  common::Envelope envelope;
  envelope.set_payload(payload.SerializeAsString());
  return envelope.SerializeAsString();
}

}  // namespace ledgerline::node
