#include "common/fabric/validation/channel_config.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <optional>

#include "common/base/check.hpp"
#include "common/base/text.hpp"
#include "common/common.pb.h"
#include "common/configtx.pb.h"
#include "common/configuration.pb.h"
#include "common/policies.pb.h"
#include "msp/msp_config.pb.h"
#include "orderer/configuration.pb.h"
#include "peer/policy.pb.h"

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
    for (const std::string& pem : *list) root.ca_pem += pem.ends_with('\n') ? pem : pem + "\n";
  }
  for (const std::string& entry : fabric.revocation_list()) {
    const auto list = crypto::list_of_entry(entry);
    if (!list) return Error{fmt::format("organisation {}: {}", printable(name), list.error().message)};
    root.revocation_lists_pem += *list;
  }
  return root;
}

/// One signature policy, or the organisations' own of that name, of which so many must agree. Fabric counts an
/// organisation without that policy as one that never agrees.
std::optional<Policy> read_policy(const common::ConfigGroup& group, const std::string& name) {
  const common::Policy* policy = policy_of(group, name);
  if (policy == nullptr) return std::nullopt;
  if (policy->type() == common::Policy::SIGNATURE) return Policy{{policy->value()}, 1};
  common::ImplicitMetaPolicy implicit;
  if (policy->type() != common::Policy::IMPLICIT_META || !implicit.ParseFromString(policy->value()))
    return std::nullopt;
  Policy out;
  for (const auto& [id, organisation] : group.groups()) {
    const common::Policy* part = policy_of(organisation, implicit.sub_policy());
    out.parts.push_back(part != nullptr && part->type() == common::Policy::SIGNATURE ? part->value() : "");
  }
  const std::size_t all = out.parts.size();
  out.needed = implicit.rule() == common::ImplicitMetaPolicy::ANY   ? 1
               : implicit.rule() == common::ImplicitMetaPolicy::ALL ? all
                                                                    : all / 2 + 1;
  LEDGERLINE_CHECK(all == 0 || out.needed <= all, "a policy wants no more parts than it has", out.needed, all);
  return out;
}

std::string words_of(const common::ConfigGroup& group, const std::string& name) {
  const common::Policy* policy = policy_of(group, name);
  if (policy == nullptr) return {};
  if (policy->type() == common::Policy::SIGNATURE) return "a signature policy";
  common::ImplicitMetaPolicy implicit;
  if (policy->type() != common::Policy::IMPLICIT_META || !implicit.ParseFromString(policy->value()))
    return "a policy of another kind";
  const char* const rule = implicit.rule() == common::ImplicitMetaPolicy::ANY   ? "ANY"
                           : implicit.rule() == common::ImplicitMetaPolicy::ALL ? "ALL"
                                                                                : "MAJORITY";
  return fmt::format("{} {}", rule, printable(implicit.sub_policy()));
}

void read_capabilities(const common::ConfigGroup& group, const std::string& of, ChannelConfig& out) {
  common::Capabilities capabilities;
  if (!read_value(group, "Capabilities", capabilities)) return;
  std::vector<std::string> names;
  for (const auto& [name, _] : capabilities.capabilities()) names.push_back(of + " " + printable(name));
  std::sort(names.begin(), names.end());
  out.capabilities.insert(out.capabilities.end(), names.begin(), names.end());
}

std::optional<Batching> read_batching(const common::ConfigGroup& ordering) {
  orderer::BatchTimeout timeout;
  orderer::BatchSize size;
  if (!read_value(ordering, "BatchTimeout", timeout) || !read_value(ordering, "BatchSize", size)) return std::nullopt;
  const auto timeout_ns = read_go_duration(timeout.timeout());
  if (!timeout_ns) return std::nullopt;
  return Batching{*timeout_ns, size.max_message_count()};
}

Status read_orderers(const common::ConfigGroup& channel, ChannelConfig& out) {
  const common::ConfigGroup* ordering = group_of(channel, "Orderer");
  if (ordering == nullptr) return Error{"it has no group Orderer"};
  orderer::ConsensusType consensus;
  if (!read_value(*ordering, "ConsensusType", consensus)) return Error{"it has no ConsensusType"};
  if (consensus.type() == "BFT") return Error{"its consensus is BFT, whose blocks need more signatures than are read"};
  out.embedded_node = consensus.type() == "ledgerline-node";
  out.consensus = printable(consensus.type());
  out.batching = read_batching(*ordering);
  read_capabilities(*ordering, "orderer", out);
  const auto add_addresses = [&](const common::ConfigGroup& group, const char* key) {
    common::OrdererAddresses addresses;
    if (!read_value(group, key, addresses)) return;
    for (const std::string& one : addresses.addresses()) out.orderer_addresses.push_back(printable(one));
  };
  for (const auto& [name, organisation] : ordering->groups()) {
    auto root = read_msp(name, organisation);
    if (!root) return root.error();
    out.orderers.push_back(std::move(*root));
    add_addresses(organisation, "Endpoints");
  }
  if (out.orderer_addresses.empty()) add_addresses(channel, "OrdererAddresses");  // of old channels
  auto policy = read_policy(*ordering, "BlockValidation");
  if (!policy) return Error{"there is no policy /Channel/Orderer/BlockValidation that can be read"};
  if (policy->parts.empty()) return Error{"it names no orderers"};
  out.block_validation = std::move(*policy);
  return done;
}

Status read_application(const common::ConfigGroup& channel, ChannelConfig& out) {
  const common::ConfigGroup* application = group_of(channel, "Application");
  if (application == nullptr) return Error{"it has no group Application"};
  for (const auto& [name, organisation] : application->groups()) {
    auto root = read_msp(name, organisation);
    if (!root) return root.error();
    // Fabric's own default, where an organisation says nothing: any of its members.
    out.endorsement_of[root->msp_id] =
        read_policy(organisation, "Endorsement").value_or(Policy{{member_policy(root->msp_id)}, 1});
    out.organisations.push_back(std::move(*root));
  }
  out.endorsement = read_policy(*application, "Endorsement").value_or(unsatisfiable_policy());
  out.lifecycle_endorsement = read_policy(*application, "LifecycleEndorsement").value_or(unsatisfiable_policy());
  out.endorsement_words = words_of(*application, "Endorsement");
  out.lifecycle_words = words_of(*application, "LifecycleEndorsement");
  read_capabilities(*application, "application", out);
  return done;
}

}  // namespace

std::optional<TimeNs> read_go_duration(std::string_view text) {
  constexpr std::array<std::pair<std::string_view, double>, 8> units{{{"ns", 1},
                                                                      {"us", 1e3},
                                                                      {"\u00b5s", 1e3},
                                                                      {"\u03bcs", 1e3},
                                                                      {"ms", 1e6},
                                                                      {"s", 1e9},
                                                                      {"m", 60e9},
                                                                      {"h", 3600e9}}};
  constexpr double max_ns = 1e18;
  if (text == "0") return 0;
  double total_ns = 0;
  for (bool first = true; first || !text.empty(); first = false) {
    double number = 0;
    const auto [end, problem] =
        std::from_chars(text.data(), text.data() + text.size(), number, std::chars_format::fixed);
    if (problem != std::errc{} || std::signbit(number)) return std::nullopt;
    text.remove_prefix(static_cast<std::size_t>(end - text.data()));
    const std::string_view unit = text.substr(0, text.find_first_of("0123456789."));
    const auto known = std::find_if(units.begin(), units.end(), [&](const auto& one) { return one.first == unit; });
    if (known == units.end()) return std::nullopt;
    text.remove_prefix(unit.size());
    total_ns += number * known->second;
    if (!(total_ns < max_ns)) return std::nullopt;
  }
  return std::llround(total_ns);
}

std::vector<crypto::MspRoot> everybody(const ChannelConfig& config) {
  std::vector<crypto::MspRoot> roots = config.organisations;
  roots.insert(roots.end(), config.orderers.begin(), config.orderers.end());
  return roots;
}

Policy application_policy(const ChannelConfig& config, const std::string& definition) {
  protos::ApplicationPolicy policy;
  if (definition.empty()) return config.endorsement;
  if (!policy.ParseFromString(definition)) return unsatisfiable_policy();
  if (policy.has_signature_policy()) return {{policy.signature_policy().SerializeAsString()}, 1};
  const std::string& reference = policy.channel_config_policy_reference();
  if (reference == "/Channel/Application/Endorsement") return config.endorsement;
  return reference == "/Channel/Application/LifecycleEndorsement" ? config.lifecycle_endorsement
                                                                  : unsatisfiable_policy();
}

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
  const common::ConfigGroup& group = config.config().channel_group();
  read_capabilities(group, "channel", out);
  if (Status status = read_orderers(group, out); !status) return wrong(status.error().message);
  if (Status status = read_application(group, out); !status) return wrong(status.error().message);
  return out;
}

}  // namespace ledgerline::fabric
