#include "tools/checks/shell/probes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <thread>

#include "common/access/grants.hpp"
#include "common/base/file.hpp"
#include "common/common.pb.h"
#include "common/config/config.hpp"
#include "common/fabric/blocks/checkpoint.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "common/msg/contract.hpp"
#include "common/verification/control_records.hpp"
#include "peer/lifecycle/lifecycle.pb.h"
#include "peer/policy.pb.h"

namespace ledgerline::checks {
namespace {

constexpr const char* ledger_check = "ledger";
constexpr auto between_heights = std::chrono::milliseconds(300);

/// What the peer of a config is asked.
class Peer {
 public:
  static Result<Peer> create(const fabric::ClientConfig& config) {
    auto questions = fabric::PeerQueries::create(config);
    if (!questions) return questions.error();
    return Peer(std::move(*questions), config.where);
  }

  verification::Evaluate contract() {
    return [this](const fabric::Call& call) { return questions_->query(where_, call); };
  }
  Result<std::uint64_t> height() { return questions_->height(); }
  Result<std::string> config_block() { return questions_->config_block(); }
  Result<std::string> block(std::uint64_t number) { return questions_->block(number); }
  Result<lifecycle::QueryChaincodeDefinitionResult> definition() {
    lifecycle::QueryChaincodeDefinitionArgs question;
    question.set_name(where_.contract);
    auto answer =
        questions_->query({where_.channel, "_lifecycle"}, {"QueryChaincodeDefinition", {question.SerializeAsString()}});
    if (!answer) return answer.error();
    lifecycle::QueryChaincodeDefinitionResult definition;
    if (!definition.ParseFromString(*answer)) return Error{"its answer cannot be read"};
    return definition;
  }

 private:
  Peer(std::unique_ptr<fabric::PeerQueries> questions, fabric::ChannelAndContract where)
      : questions_(std::move(questions)), where_(std::move(where)) {}
  std::unique_ptr<fabric::PeerQueries> questions_;
  fabric::ChannelAndContract where_;
};

/// One peer alone would do.
bool is_weak(const std::string& definition, const fabric::ChannelConfig& channel) {
  protos::ApplicationPolicy policy;
  if (!policy.ParseFromString(definition)) return false;
  if (!policy.has_signature_policy() && channel.organisations.size() == 1) return false;
  const fabric::Policy endorsement = fabric::application_policy(channel, definition);
  return std::any_of(channel.organisations.begin(), channel.organisations.end(), [&](const crypto::MspRoot& one) {
    return fabric::satisfies(endorsement, {{.msp_id = one.msp_id, .peer = true, .identity = one.msp_id}});
  });
}

/// Whose signatures new records of the contract need, and who could give them; none: that is not known, which `out`
/// says.
std::optional<NeededSignatures> query_configuration(Peer& peer, const ProgramConfig& one, const std::string& anchor,
                                                    bool embedded, std::chrono::milliseconds timeout, Findings& out) {
  // The newest, where the peer reports it; a change of the times since the anchor counts.
  auto newest = peer.config_block();
  const std::string& block = newest ? *newest : anchor;
  common::Block parsed;
  const auto channel = parsed.ParseFromString(block) ? fabric::read_channel_config(parsed)
                                                     : Result<fabric::ChannelConfig>(Error{"it is no block"});
  if (!channel || !channel->batching) {
    out.push_back(flag(Problem::ledger_refuses, ledger_check,
                       "its configuration: " + (channel ? "it has no BatchTimeout" : channel.error().message)));
  } else if (one.program == "agent" || one.program == "ground") {
    TimeoutInputs inputs{
        .program = one.file, .deadline_ns = one.ledger->deadline_ns, .of_channel = one.ledger->patient};
    if (one.program == "agent") {
      inputs.max_age_ns = one.max_age_ns;
      inputs.silent_after_ns = one.silent_after_ns;
    }
    out.push_back(assess(*channel->batching, inputs));
  }
  if (channel && !embedded && one.ledger->orderers.empty()) {  // those of the config are checked as servers
    std::vector<ServerInputs> orderers;
    for (const std::string& address : channel->orderer_addresses)
      orderers.push_back(probe_server({.endpoint = address}, "channel " + channel->channel + "'s orderers", timeout));
    add(out, assess_orderers(orderers));
  }
  ContractInputs contract{.name = one.ledger->contract, .own_version = contract::version};
  std::string policy;
  if (embedded) {
    out.push_back(fine("contract", contract.name + " of the embedded ledger"));
  } else {
    const auto definition = peer.definition();
    if (definition) {
      policy = definition->validation_parameter();
      contract.version = definition->version();
      contract.weak = channel && is_weak(policy, *channel);
    } else {
      contract.refused = definition.error().message;
    }
    add(out, assess(contract));
  }
  if (!channel || !contract.refused.empty()) return std::nullopt;
  NeededSignatures needed{.policy = fabric::application_policy(*channel, policy)};
  for (const crypto::MspRoot& organisation : channel->organisations)
    needed.organisations.push_back(organisation.msp_id);
  return needed;
}

/// The organisations whose drones they are; none: the contract does not answer, which `out` says.
std::optional<std::set<std::string>> query_records(Peer& peer, const ProgramConfig& one,
                                                   const crypto::IdentityName& self,
                                                   const std::vector<std::string>& drones, Findings& out) {
  const Side side = one.program == "agent" ? Side::agent : Side::ground;
  const auto roles = verification::read_roles(peer.contract(), {self.msp_id});
  std::set<std::string> owners;
  for (const std::string& drone : drones) {
    LeaseInputs inputs{.drone = drone, .self = self, .side = side, .control = {}};
    if (roles) inputs.is_operator = is_operator(roles->of(self));
    if (auto control = verification::read_control(drone, peer.contract())) {
      owners.insert(control->owner().msp_id());
      inputs.control = std::move(*control);
    } else if (!roles) {
      out.push_back(assess_refusal(control.error().message));
      return std::nullopt;
    }
    add(out, assess(inputs));
  }
  return owners;
}

/// Whether the peer's chain goes on behind what the program has verified: else it would not start.
void compare_with_checkpoint(Peer& peer, const ProgramConfig& one, const std::string& checkpoint,
                             const std::string& newest_block, Findings& out) {
  const auto refused = [&](const Error& why) {
    out.push_back(flag(Problem::checkpoint_refused, "chain", fmt::format("{}: {}", one.file, why.message)));
  };
  const auto kept = fabric::read_checkpoint(checkpoint, one.ledger->channel);
  if (!kept) return refused(kept.error());
  common::Block newest;
  if (!*kept || !newest.ParseFromString(newest_block)) return;
  bool answered = true;
  const auto fetch = [&](std::uint64_t number) -> Result<common::Block> {
    common::Block block;
    const auto bytes = peer.block(number);
    answered = bytes.ok() && block.ParseFromString(*bytes);
    return answered ? Result<common::Block>(std::move(block)) : Result<common::Block>(Error{"it is no block"});
  };
  const auto behind = fabric::continue_behind({**kept, 0}, newest, fetch);
  if (!behind && answered) refused(behind.error());
}

}  // namespace

Findings query_ledger(const ProgramConfig& one, const std::string& anchor, bool embedded,
                      const std::vector<std::string>& drones, std::chrono::milliseconds timeout) {
  Findings out;
  const auto wrong = [&](const Error& why) -> Findings {
    return {flag(Problem::config_wrong, "config", fmt::format("{}: {}", one.path, why.message))};
  };
  auto config = Config::load(one.path);
  if (!config) return wrong(config.error());
  auto ledger = client_of_channel(*config, one);
  if (!ledger) return wrong(ledger.error());
  ledger->deadline = timeout;
  auto peer = Peer::create(*ledger);
  if (!peer) return wrong(peer.error());
  const auto height = peer->height();
  if (!height)
    return {flag(Problem::ledger_refuses, ledger_check,
                 fmt::format("{}: {}", one.ledger->peer.endpoint, height.error().message))};
  auto needed = query_configuration(*peer, one, anchor, embedded, timeout, out);
  const auto owners = query_records(*peer, one, ledger->identity.name, drones, out);
  if (needed && owners) {
    needed->owners = *owners;
    add(out, query_endorsers(one, *ledger, *needed));
  }
  std::this_thread::sleep_for(between_heights);
  HeightInputs inputs{.place = one.ledger->peer.endpoint, .height = *height, .later = *height};
  if (auto later = peer->height()) inputs.later = *later;
  const std::string checkpoint = one.label.empty() ? config->text("output.checkpoint", "") : "";
  if (auto block = peer->block(inputs.later - 1)) {
    inputs.newest_age_ns = age_of_block(*block, realtime_ns());
    compare_with_checkpoint(*peer, one, checkpoint, *block, out);
  }
  for (const ServerKeys& other : one.ledger->endorsers) {
    if (other.endpoint == one.ledger->peer.endpoint || inputs.elsewhere) continue;
    auto second = Peer::create(client_at(other, *ledger));
    if (!second) continue;
    if (auto its = second->height()) inputs.elsewhere = *its;
  }
  add(out, assess(inputs));
  return out;
}

}  // namespace ledgerline::checks
