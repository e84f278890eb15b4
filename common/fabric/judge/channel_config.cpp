#include "common/fabric/judge/channel_config.hpp"

#include <fmt/format.h>

#include "common/base/printable.hpp"
#include "common/common.pb.h"
#include "common/configtx.pb.h"
#include "common/policies.pb.h"
#include "msp/msp_config.pb.h"
#include "orderer/configuration.pb.h"

namespace ledgerline::fabric {
namespace {

constexpr int fabric_msp = 0;  // msp.ProviderType of Fabric: X.509

template <typename Message>
bool read_value(const common::ConfigGroup& group, const std::string& name, Message& value) {
  const auto found = group.values().find(name);
  return found != group.values().end() && value.ParseFromString(found->second.value());
}

const common::ConfigGroup* group_of(const common::ConfigGroup& group, const std::string& name) {
  const auto found = group.groups().find(name);
  return found == group.groups().end() ? nullptr : &found->second;
}

const common::Policy* policy_of(const common::ConfigGroup& group, const std::string& name) {
  const auto found = group.policies().find(name);
  return found == group.policies().end() ? nullptr : &found->second.policy();
}

Result<crypto::MspRoot> read_msp(const std::string& name, const common::ConfigGroup& organisation) {
  msp::MSPConfig config;
  msp::FabricMSPConfig fabric;
  if (!read_value(organisation, "MSP", config) || config.type() != fabric_msp ||
      !fabric.ParseFromString(config.config())) {
    return Error{fmt::format("organisation {} has no MSP of X.509 certificates", printable(name))};
  }
  crypto::MspRoot root{fabric.name(), {}};
  for (const auto* list : {&fabric.root_certs(), &fabric.intermediate_certs()}) {
    for (const std::string& pem : *list) root.ca_pem += pem + "\n";
  }
  return root;
}

/// A policy over the orderers' organisations, as parts that are signature policies.
Status read_block_policy(const common::ConfigGroup& ordering, ChannelConfig& out) {
  const common::Policy* policy = policy_of(ordering, "BlockValidation");
  if (policy == nullptr) return Error{"there is no policy /Channel/Orderer/BlockValidation"};
  if (policy->type() == common::Policy::SIGNATURE) {
    out.block_policies.push_back(policy->value());
    out.block_policies_needed = 1;
    return done;
  }
  common::ImplicitMetaPolicy implicit;
  if (policy->type() != common::Policy::IMPLICIT_META || !implicit.ParseFromString(policy->value()))
    return Error{"the policy /Channel/Orderer/BlockValidation is of no known type"};
  for (const auto& [name, organisation] : ordering.groups()) {
    const common::Policy* part = policy_of(organisation, implicit.sub_policy());
    // Fabric counts an organisation without that policy as one that never agrees.
    out.block_policies.push_back(part != nullptr && part->type() == common::Policy::SIGNATURE ? part->value() : "");
  }
  const std::size_t all = out.block_policies.size();
  out.block_policies_needed = implicit.rule() == common::ImplicitMetaPolicy::ANY   ? 1
                              : implicit.rule() == common::ImplicitMetaPolicy::ALL ? all
                                                                                   : all / 2 + 1;
  if (all == 0) return Error{"it names no orderers"};
  return done;
}

Status read_group(const common::ConfigGroup& channel, ChannelConfig& out) {
  const common::ConfigGroup* ordering = group_of(channel, "Orderer");
  if (ordering == nullptr) return Error{"it has no group Orderer"};
  orderer::ConsensusType consensus;
  if (!read_value(*ordering, "ConsensusType", consensus)) return Error{"it has no ConsensusType"};
  if (consensus.type() == "BFT") return Error{"its consensus is BFT, whose blocks need more signatures than are read"};
  for (const auto& [name, organisation] : ordering->groups()) {
    auto root = read_msp(name, organisation);
    if (!root) return root.error();
    out.orderers.push_back(std::move(*root));
  }
  return read_block_policy(*ordering, out);
}

}  // namespace

Result<ChannelConfig> read_channel_config(const common::Block& block) {
  ChannelConfig out;
  out.block = block.header().number();
  const auto wrong = [&](const std::string& why) { return Error{fmt::format("config block {}: {}", out.block, why)}; };
  common::Envelope envelope;
  common::Payload payload;
  common::ChannelHeader header;
  common::ConfigEnvelope config;
  if (block.data().data_size() != 1 || !envelope.ParseFromString(block.data().data(0)) ||
      !payload.ParseFromString(envelope.payload()) || !header.ParseFromString(payload.header().channel_header()) ||
      header.type() != common::CONFIG || !config.ParseFromString(payload.data())) {
    return wrong("it holds no configuration");
  }
  out.channel = header.channel_id();
  if (Status status = read_group(config.config().channel_group(), out); !status) return wrong(status.error().what);
  return out;
}

}  // namespace ledgerline::fabric
