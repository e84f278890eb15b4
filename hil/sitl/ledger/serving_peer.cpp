#include "hil/sitl/ledger/serving_peer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "chaincode/node/core/tx/messages.hpp"
#include "common/base/enum_count.hpp"
#include "common/base/random.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::hil {
namespace {

constexpr TimeNs some_time_ns = 1'767'225'600 * ns_per_s;

protos::ChaincodeInvocationSpec call_of(const fabric::OpenedTransaction& opened) {
  const auto proposal = parsed<protos::ChaincodeProposalPayload>(opened.action.chaincode_proposal_payload());
  return parsed<protos::ChaincodeInvocationSpec>(proposal.input());
}

std::string faster(const std::string& command) {
  auto plans = parsed<CommandCall>(command);
  for (DronePlan& plan : *plans.mutable_plans()) {
    for (PlannedSetpoint& setpoint : *plan.mutable_setpoints()) setpoint.set_vx(2);
    plan.set_sequence(plan.sequence() + 1000);
  }
  return plans.SerializeAsString();
}

/// As a peer's contract would answer, with that event.
std::string own_transaction(const crypto::SigningIdentity& peer, const fabric::Call& call, const std::string& event,
                            std::uint64_t number) {
  std::string nonce = std::to_string(number);
  nonce.resize(24, '.');
  const auto proposal = fabric::make_proposal(peer, {}, call, some_time_ns, nonce);
  if (!proposal) return {};
  const auto signed_proposal = parsed<protos::SignedProposal>(proposal->signed_proposal);
  const auto whole = parsed<protos::Proposal>(signed_proposal.proposal_bytes());
  const auto header = parsed<common::Header>(whole.header());
  protos::ChaincodeEvent sent;
  sent.set_chaincode_id("ledgerline");
  sent.set_tx_id(proposal->tx_id);
  sent.set_event_name(call.function);
  sent.set_payload(event);
  protos::ChaincodeAction action;
  action.mutable_chaincode_id()->set_name("ledgerline");
  action.mutable_chaincode_id()->set_version("1");
  action.mutable_response()->set_status(200);
  action.set_events(sent.SerializeAsString());
  protos::ProposalResponsePayload payload;
  payload.set_proposal_hash(fabric::proposal_hash(header.channel_header(), header.signature_header(), whole.payload()));
  payload.set_extension(action.SerializeAsString());
  protos::ProposalResponse response;
  response.mutable_response()->set_status(200);
  response.set_payload(payload.SerializeAsString());
  response.mutable_endorsement()->set_endorser(peer.serialized);
  const auto signature = peer.signer->sign(response.payload() + peer.serialized);
  if (signature) response.mutable_endorsement()->set_signature(*signature);
  const auto envelope = fabric::assemble(*proposal, {response.SerializeAsString()});
  const auto sealed = envelope ? fabric::sign_envelope(peer, *envelope) : envelope;
  return sealed ? *sealed : std::string();
}

}  // namespace

std::string called_function(const std::string& envelope) {
  const auto opened = fabric::open_transaction(envelope);
  if (!opened) return {};
  const auto call = call_of(*opened);
  const auto& args = call.chaincode_spec().input().args();
  return args.empty() ? std::string() : args[0];
}

void tamper_plan(std::string& envelope) {
  auto opened = fabric::open_transaction(envelope);
  if (!opened) return;
  auto event = parsed<protos::ChaincodeEvent>(opened->result.events());
  event.set_payload(faster(event.payload()));
  opened->result.set_events(event.SerializeAsString());
  opened->seal_result();
  envelope = opened->bytes();
}

void break_creator(std::string& envelope) {
  auto whole = parsed<common::Envelope>(envelope);
  if (!whole.signature().empty()) (*whole.mutable_signature())[0] ^= 1;
  envelope = whole.SerializeAsString();
}

void endorse_by(std::string& envelope, const crypto::SigningIdentity* peer) {
  auto opened = fabric::open_transaction(envelope);
  if (!opened) return;
  auto& action = *opened->action.mutable_action();
  action.clear_endorsements();
  if (peer != nullptr) {
    protos::Endorsement& one = *action.add_endorsements();
    one.set_endorser(peer->serialized);
    const auto signature = peer->signer->sign(action.proposal_response_payload() + peer->serialized);
    if (signature) one.set_signature(*signature);
  }
  envelope = opened->bytes();
}

void name_channel(std::string& envelope, const std::string& channel) {
  auto opened = fabric::open_transaction(envelope);
  if (!opened) return;
  auto header = parsed<common::ChannelHeader>(opened->payload.header().channel_header());
  header.set_channel_id(channel);
  opened->payload.mutable_header()->set_channel_header(header.SerializeAsString());
  envelope = opened->bytes();
}

std::string own_stop(const crypto::SigningIdentity& peer, std::uint64_t number) {
  DronesCall drones;
  drones.add_drones("tello1");
  Stops stops;
  stops.add_stops()->set_drone("tello1");
  return own_transaction(peer, {contract::stop, {drones.SerializeAsString()}}, stops.SerializeAsString(), number);
}

std::string own_command(const crypto::SigningIdentity& peer, const std::string& envelope, std::uint64_t number) {
  const auto opened = fabric::open_transaction(envelope);
  if (!opened) return {};
  const auto call = call_of(*opened);
  const auto& args = call.chaincode_spec().input().args();
  if (args.size() < 2) return {};
  const std::string plans = faster(args[1]);
  return own_transaction(peer, {contract::command, {plans}}, plans, number);
}

std::string own_config(const crypto::SigningIdentity& peer, const std::string& authority) {
  node::CoreConfig config;
  config.organisations = {{peer.name.msp_id, authority}};
  config.orderers = {peer.name.msp_id, authority};
  return node::make_config_envelope(config, peer);
}

void name_config(std::string& signatures, std::uint64_t number) {
  auto metadata = parsed<common::Metadata>(signatures);
  auto value = parsed<common::OrdererBlockMetadata>(metadata.value());
  value.mutable_last_config()->set_index(number);
  metadata.set_value(value.SerializeAsString());
  signatures = metadata.SerializeAsString();
}

namespace {

constexpr TimeNs delay_ns = 2 * ns_per_s, max_stutter_ns = 1 * ns_per_s, own_period_ns = 100 * ns_per_ms;
constexpr std::uint64_t max_age_blocks = 20;

bool is_stop(const std::string& envelope) { return called_function(envelope) == contract::stop; }
bool is_command(const std::string& envelope) { return called_function(envelope) == contract::command; }
bool is_control(const std::string& envelope) {
  const std::string function = called_function(envelope);
  return !function.empty() && function != contract::set && function != contract::command && function != contract::stop;
}

bool has(const common::Block& block, bool (*is)(const std::string& envelope)) {
  return std::any_of(block.data().data().begin(), block.data().data().end(), is);
}

void rehash(common::Block& block) { block.mutable_header()->set_data_hash(fabric::data_hash(block.data())); }

/// Mixed by seed and number, so that the same flight is the same.
std::uint64_t drawn(std::uint64_t seed, std::uint64_t number) { return Random(seed ^ (number * 0x9e3779b9ULL)).next(); }

}  // namespace

PeerKeys test_peer_keys() {
  return {crypto::make_test_identity({"Org1MSP", "CN=peer0"}), "test authority of Org1MSP",
          crypto::make_test_identity({"Org2MSP", "CN=peer0"})};
}

PeerKeys test_orderer_keys() {
  PeerKeys keys = test_peer_keys();
  keys.peer = crypto::make_test_identity({"OrdererMSP", "CN=orderer"});
  return keys;
}

ServingPeer::ServingPeer(BlockPtr first, std::uint64_t seed, PeerKeys keys) : keys_(std::move(keys)), seed_(seed) {
  blocks_.push_back({std::move(first), 0});
}

void ServingPeer::set_tampering(PeerTampering tampering) {
  if (tampering == tampering_) return;
  tampering_ = tampering;
  fork_.reset();
  lied_from_ = height();
}

std::string ServingPeer::orders(TimeNs now) {
  if (tampering_ != PeerTampering::trusts_own || now < next_order_ns_) return {};
  next_order_ns_ = now + own_period_ns;
  const auto number = static_cast<std::uint64_t>(now);
  const std::string command = newest_command();
  return command.empty() || drawn(seed_, number) % 2 == 0 ? own_stop(keys_.peer, number)
                                                          : own_command(keys_.peer, command, number);
}

ServingPeer::BlockPtr ServingPeer::newest(TimeNs now) {
  if (tampering_ != PeerTampering::grows_old) return serve(now, height() - 1);
  return at(lied_from_ > max_age_blocks ? lied_from_ - max_age_blocks : 0);
}

void ServingPeer::add(TimeNs now, BlockPtr block) { blocks_.push_back({std::move(block), now}); }

std::string ServingPeer::newest_command() const {
  for (auto kept = blocks_.rbegin(); kept != blocks_.rend(); ++kept) {
    const auto& envelopes = kept->block->data().data();
    const auto command = std::find_if(envelopes.begin(), envelopes.end(), is_command);
    if (command != envelopes.end()) return *command;
  }
  return {};
}

ServingPeer::BlockPtr ServingPeer::at(std::uint64_t number) const {
  return number < blocks_.size() ? blocks_[number].block : nullptr;
}

Result<common::Block> ServingPeer::fetch(std::uint64_t number) const {
  const BlockPtr block = at(number);
  if (!block || tampering_ == PeerTampering::withholds)
    return Error{fmt::format("the peer does not give block {}", number)};
  return *block;
}

bool ServingPeer::holds_back(PeerTampering tampering, TimeNs now, const Kept& next) const {
  switch (tampering) {
    case PeerTampering::withholds:
    case PeerTampering::grows_old:
      return true;
    case PeerTampering::withholds_stops:
      return has(*next.block, is_stop);
    case PeerTampering::withholds_commands:
      return has(*next.block, is_command);
    case PeerTampering::delays:
      return now - next.came_ns < delay_ns;
    case PeerTampering::stutters:
      return now - next.came_ns <
             static_cast<TimeNs>(drawn(seed_, next.block->header().number()) % std::uint64_t(max_stutter_ns));
    default:
      return false;
  }
}

ServingPeer::BlockPtr ServingPeer::serve(TimeNs now, std::uint64_t wanted) {
  PeerTampering tampering = tampering_;
  if (tampering == PeerTampering::mixes) {
    tampering = static_cast<PeerTampering>(1 + drawn(seed_, wanted) % (enum_count<PeerTampering> - 2));  // not `mixes`
    // One for a while: else the first that it withholds for good is the only one that is seen.
    if (tampering == PeerTampering::withholds || tampering == PeerTampering::withholds_commands ||
        tampering == PeerTampering::grows_old)
      tampering = PeerTampering::stutters;
  }
  const BlockPtr next = at(wanted);
  if (!next || wanted == 0 || tampering == PeerTampering::none) return next;
  if (tampering == PeerTampering::signs_reordered && !at(wanted + 1)) return nullptr;
  if (holds_back(tampering, now, blocks_[wanted])) return nullptr;
  return tampered(tampering, wanted);
}

void ServingPeer::tamper_flags(PeerTampering tampering, common::Block& block) const {
  std::string flags = block.metadata().metadata(common::TRANSACTIONS_FILTER);
  for (std::size_t i = 0; i < flags.size(); ++i) {
    const std::string& envelope = block.data().data(static_cast<int>(i));
    const bool hides = (tampering == PeerTampering::hides_commands && is_command(envelope)) ||
                       (tampering == PeerTampering::hides_stops && is_stop(envelope)) ||
                       (tampering == PeerTampering::hides_controls && is_control(envelope)) ||
                       tampering == PeerTampering::hides_all ||
                       (tampering == PeerTampering::hides_some && drawn(seed_, block.header().number() + i) % 3 == 0);
    if (hides) flags[i] = static_cast<char>(protos::MVCC_READ_CONFLICT);
    if (tampering == PeerTampering::hides_stops_as_double && is_stop(envelope))
      flags[i] = static_cast<char>(protos::DUPLICATE_TXID);
    if (tampering == PeerTampering::trusts_own) flags[i] = static_cast<char>(protos::VALID);
  }
  if (tampering == PeerTampering::no_flags) flags.clear();
  block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, flags);
}

/// False: there is nothing in this block to tamper with.
bool ServingPeer::tamper_data(PeerTampering tampering, common::Block& block) {
  auto& data = *block.mutable_data();
  const auto command = std::find_if(data.mutable_data()->begin(), data.mutable_data()->end(), is_command);
  const bool has_command = command != data.mutable_data()->end();
  switch (tampering) {
    case PeerTampering::signs_own_stop:
      data.add_data(own_stop(keys_.peer, block.header().number()));
      return true;
    case PeerTampering::signs_own_command:
      if (has_command) data.add_data(own_command(keys_.peer, *command, block.header().number()));
      return has_command;
    case PeerTampering::signs_left_out:
      data.mutable_data()->RemoveLast();
      return true;
    case PeerTampering::signs_reordered:
      if (const BlockPtr next = at(block.header().number() + 1)) data = next->data();
      return at(block.header().number() + 1) != nullptr;
    case PeerTampering::signs_replayed: {
      const std::string again = newest_command();
      if (!again.empty()) data.add_data(again);
      return !again.empty();
    }
    case PeerTampering::signs_empty:
      data.clear_data();
      return true;
    case PeerTampering::signs_config:
      data.clear_data();
      data.add_data(own_config(keys_.peer, keys_.authority));
      return true;
    default:
      break;
  }
  if (!has_command) return false;
  if (tampering == PeerTampering::signs_broken_creator) {
    break_creator(*command);
  } else if (tampering == PeerTampering::signs_without_endorsement) {
    endorse_by(*command, nullptr);
  } else if (tampering == PeerTampering::signs_outsiders_endorsement) {
    endorse_by(*command, &keys_.outsider);
  } else if (tampering == PeerTampering::signs_other_channel) {
    name_channel(*command, "another");
  } else {
    tamper_plan(*command);
  }
  return true;
}

/// A chain that leaves the ledger's behind: with its transactions, but for the commands.
ServingPeer::BlockPtr ServingPeer::forked(PeerTampering tampering, std::uint64_t wanted) {
  if (!fork_ || fork_->first != wanted) fork_.emplace(wanted, fabric::header_hash(at(wanted - 1)->header()));
  std::vector<std::string> envelopes;
  for (const std::string& one : at(wanted)->data().data()) {
    if (!is_command(one)) envelopes.push_back(one);
  }
  auto block = std::make_shared<common::Block>(node::make_block({wanted, fork_->second}, envelopes));
  if (tampering == PeerTampering::forks) (void)node::sign_block(*block, keys_.peer);
  block->mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, std::string(envelopes.size(), protos::VALID));
  fork_.emplace(wanted + 1, fabric::header_hash(block->header()));
  return block;
}

ServingPeer::BlockPtr ServingPeer::tampered(PeerTampering tampering, std::uint64_t wanted) {
  const BlockPtr honest = at(wanted);
  if (tampering == PeerTampering::skips) return at(wanted + 1);
  if (tampering == PeerTampering::repeats) return at(wanted - 1);
  if (tampering == PeerTampering::forks || tampering == PeerTampering::forks_unsigned) return forked(tampering, wanted);
  auto block = std::make_shared<common::Block>(*honest);
  auto& signatures = *block->mutable_metadata()->mutable_metadata(common::SIGNATURES);
  if (tampering >= PeerTampering::hides_commands && tampering <= PeerTampering::no_flags) {
    tamper_flags(tampering, *block);
  } else if (tampering == PeerTampering::loses_block_signatures) {
    signatures.clear();
  } else if (tampering == PeerTampering::swaps_block_signatures) {
    signatures = at(wanted - 1)->metadata().metadata(common::SIGNATURES);
  } else if (tampering == PeerTampering::names_other_config) {
    name_config(signatures, wanted - 1);
  } else if (tampering == PeerTampering::mixes_headers) {
    *block->mutable_header() = at(wanted - 1)->header();
    block->mutable_header()->set_number(wanted);
  } else if (tampering == PeerTampering::renumbers) {
    block->mutable_header()->set_number(wanted + 1);
  } else if (tampering == PeerTampering::turns_away) {
    (*block->mutable_header()->mutable_previous_hash())[0] ^= 1;
  } else if (tampering == PeerTampering::garbage) {
    block->mutable_data()->add_data("garbage");
  } else if (tampering >= PeerTampering::bends_plan && tampering <= PeerTampering::signs_config) {
    if (!tamper_data(tampering, *block)) return honest;
    if (tampering != PeerTampering::bends_plan) rehash(*block);
    if (tampering >= PeerTampering::signs_bent_plan) {
      (void)node::sign_block(*block, keys_.peer);
      block->mutable_metadata()->set_metadata(
          common::TRANSACTIONS_FILTER,
          std::string(static_cast<std::size_t>(block->data().data_size()), static_cast<char>(protos::VALID)));
    }
  }
  return block;
}

}  // namespace ledgerline::hil
