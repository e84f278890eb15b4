#include "tools/ledger/decode.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/names.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/ros.hpp"
#include "peer/transaction.pb.h"

namespace ledgerline::ledger {
namespace {

using json = nlohmann::ordered_json;

std::optional<json> decoded(std::string_view bytes, google::protobuf::Message& message) {
  if (!parse_message(bytes, message)) return std::nullopt;
  json value = json::parse(to_json(message), nullptr, false);
  if (value.is_discarded()) return std::nullopt;
  // As `ledgerline audit` has it, in the place of Base64.
  if (const auto* anchored = dynamic_cast<const AnchorCall*>(&message))
    value["digest"] = crypto::hex(anchored->digest());
  return value;
}

template <typename Message>
std::optional<json> as(std::string_view bytes) {
  Message message;
  return decoded(bytes, message);
}

/// A record of the contract, whose type is its message's name; none: of another.
std::optional<json> record_of(const std::string& type, std::string_view bytes) {
  const auto* known = google::protobuf::DescriptorPool::generated_pool()->FindMessageTypeByName(type);
  if (known == nullptr || !type.starts_with("ledgerline.")) return std::nullopt;
  const std::unique_ptr<google::protobuf::Message> message(
      google::protobuf::MessageFactory::generated_factory()->GetPrototype(known)->New());
  return decoded(bytes, *message);
}

std::optional<json> set_call(std::string_view bytes) {
  SetCall call;
  if (!parse_message(bytes, call)) return std::nullopt;
  json assets = json::array();
  for (const Asset& asset : call.assets()) assets.push_back(asset_json(asset));
  return json{{"stream", call.stream()}, {"assets", std::move(assets)}};
}

using Decode = std::optional<json> (*)(std::string_view bytes);

/// The message that a function takes; none: it takes plain arguments, or is not the contract's.
Decode message_of(const std::string& function) {
  using namespace contract;
  static const std::map<std::string, Decode, std::less<>> known{{set, set_call},
                                                                {contract::command, as<CommandCall>},
                                                                {enroll, as<EnrollCall>},
                                                                {revoke, as<RevokeCall>},
                                                                {grant, as<GrantCall>},
                                                                {acquire, as<LeaseCall>},
                                                                {release, as<LeaseCall>},
                                                                {request, as<LeaseCall>},
                                                                {hand_over, as<AnswerCall>},
                                                                {deny, as<AnswerCall>},
                                                                {evict, as<DronesCall>},
                                                                {stop, as<DronesCall>},
                                                                {clear_stop, as<DronesCall>},
                                                                {apply_stops, as<DronesCall>},
                                                                {anchor, as<AnchorCall>},
                                                                {delete_, as<DeleteCall>}};
  const auto found = known.find(function);
  return found == known.end() ? nullptr : found->second;
}

std::string time_of(TimeNs real_ns) {
  if (real_ns <= 0) return "a time that is none";
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z", fmt::gmtime(static_cast<std::time_t>(real_ns / ns_per_s)),
                     real_ns / ns_per_ms % 1000);
}

std::string name_of(std::string_view serialized) {
  const auto named = crypto::read_serialized(serialized);
  return named ? printable(named->name.msp_id + " " + named->name.subject) : "somebody who cannot be identified";
}

std::string verdict_of(int code) {
  if (code == fabric::code_unverified) return "flagged valid, but it cannot be";
  if (code < 0) return "none yet: the block came from an orderer";
  return protos::TxValidationCode_IsValid(code)
             ? protos::TxValidationCode_Name(static_cast<protos::TxValidationCode>(code))
             : fmt::format("unknown code {}", code);
}

json bytes_of(std::string_view bytes) { return {{"bytes", bytes.size()}}; }

std::optional<json> transitions_of(const std::string& data) {
  const auto transitions = transitions_from_cdr(data);
  if (!transitions) return std::nullopt;
  json all = json::array();
  for (const Transition& one : *transitions) {
    all.push_back({{"number", one.number},
                   {"phase", name(one.phase)},
                   {"mode", name(one.mode)},
                   {"cause", name(one.cause)},
                   {"stamp_ns", one.stamp_ns},
                   {"boot_id", std::to_string(one.boot_id)}});  // beyond what JSON's numbers hold
  }
  return all;
}

std::optional<json> alarms_of(const std::string& data) {
  const auto alarms = alarms_from_cdr(data);
  if (!alarms) return std::nullopt;
  json all = json::array();
  for (const Alarm& one : *alarms) {
    all.push_back({{"kind", printable(one.kind)},
                   {"stands", one.stands},
                   {"count", one.count},
                   {"words", printable(one.words)},
                   {"block", one.block}});
  }
  return all;
}

/// Of the types that this project puts on the ledger; none: another.
std::optional<json> value_of(const Asset& asset) {
  const std::string& type = asset.msg_type();
  const std::string& data = asset.msg_data();
  if (type == odometry_type) {
    const auto odometry = odometry_from_cdr(data);
    if (!odometry) return std::nullopt;
    return json{{"time", time_of(odometry->header.stamp_ns)},
                {"frame", printable(odometry->header.frame_id)},
                {"position_m", odometry->position_m},
                {"orientation_xyzw", odometry->orientation},
                {"linear_mps", odometry->linear_mps}};
  }
  if (type == battery_type) {
    const auto battery = battery_from_cdr(data);
    if (!battery) return std::nullopt;
    return json{{"time", time_of(battery->header.stamp_ns)}, {"percentage", battery->percentage}};
  }
  if (type == link_status_type) {
    const auto state = state_from_cdr(data, "");
    if (!state) return std::nullopt;
    const StateSample& sample = state->sample;
    return json{{"time", time_of(state->real_ns)},
                {"phase", name(sample.phase)},
                {"mode", name(sample.mode)},
                {"cause", name(sample.cause)}};
  }
  if (type == alarms_type && asset.id().ends_with("/alarm")) return alarms_of(data);
  if (type == transitions_type) return transitions_of(data);
  return record_of(type, data);
}

/// An array of numbers stays in one line.
bool is_flat(const json& value) {
  return !value.is_structured() || value.empty() ||
         (value.is_array() && std::ranges::none_of(value, [](const json& one) { return one.is_structured(); }));
}

std::string flat(const json& value) {
  if (value.is_string()) return printable(value.get_ref<const std::string&>());
  if (!value.is_array()) return value.is_object() ? "-" : value.dump();
  std::string all;
  for (const json& one : value) all += (all.empty() ? "" : ", ") + flat(one);
  return all.empty() ? "-" : all;
}

void add_lines(const json& value, std::size_t indent, std::string& out) {
  const std::string blanks(indent, ' ');
  if (value.is_object()) {
    for (const auto& [key, one] : value.items()) {
      out += fmt::format("{}{}:{}", blanks, printable(key), is_flat(one) ? " " + flat(one) + "\n" : "\n");
      if (!is_flat(one)) add_lines(one, indent + 2, out);
    }
  } else if (value.is_array() && !is_flat(value)) {
    for (const json& one : value) {
      std::string item;
      add_lines(one, indent + 2, item);
      if (item.size() <= indent) item = std::string(indent + 2, ' ') + "-\n";  // an empty object
      item[indent] = '-';
      out += item;
    }
  } else {
    out += blanks + flat(value) + "\n";
  }
}

}  // namespace

json arguments_json(const std::string& function, const std::vector<std::string>& arguments) {
  const Decode decode = message_of(function);
  json all = json::array();
  for (const std::string& argument : arguments) {
    const bool plain = is_plain(argument);
    const std::optional<json> message = decode && !plain ? decode(argument) : std::nullopt;
    all.push_back(message ? *message : plain ? json(argument) : bytes_of(argument));
  }
  return all.size() == 1 ? all.front() : all;
}

json asset_json(const Asset& asset) {
  json one{{"id", printable(asset.id())}, {"type", printable(asset.msg_type())}};
  const auto value = value_of(asset);
  if (value)
    one["value"] = *value;
  else
    one.update(bytes_of(asset.msg_data()));
  return one;
}

json transaction_json(const fabric::Block& block, const fabric::Transaction& transaction) {
  json one{{"transaction", printable(transaction.tx_id)},
           {"block", block.number},
           {"block_hash", crypto::hex(fabric::block_header_hash(block.number, block.previous_hash, block.data_hash))},
           {"channel", printable(transaction.channel)},
           {"code", transaction.code},
           {"verdict", verdict_of(transaction.code)}};
  if (transaction.config) {
    one["what"] = "a change of the channel's configuration";
    return one;
  }
  json endorsers = json::array();
  for (const fabric::Endorsement& endorsement : transaction.endorsements)
    endorsers.push_back(name_of(endorsement.endorser));
  one.update({{"time", time_of(transaction.timestamp_ns)},
              {"creator", name_of(transaction.creator)},
              {"contract", printable(transaction.contract)},
              {"function", printable(transaction.function)},
              {"arguments", arguments_json(transaction.function, transaction.args)},
              {"event", printable(transaction.event_name)},
              {"endorsers", std::move(endorsers)}});
  if (!transaction.problem.empty()) one["problem"] = printable(transaction.problem);
  return one;
}

void TransactionSearch::add(const std::string& bytes) {
  const auto block = fabric::decode_block(bytes);
  if (!block) {
    damage_ = block.error().message;
    return;
  }
  for (const fabric::Transaction& one : block->transactions) {
    if (beginning_.empty() || !one.tx_id.starts_with(beginning_)) continue;
    if (!first_) first_ = transaction_json(*block, one);
    if (ids_.size() < max_ids) ids_.insert(one.tx_id);
  }
}

Result<json> TransactionSearch::result() const {
  if (ids_.size() > 1)
    return Error{fmt::format("{} transactions begin with {}: type more of it",
                             ids_.size() < max_ids ? std::to_string(ids_.size()) : fmt::format("{} or more", max_ids),
                             printable(beginning_))};
  // Another one that begins so may be in the part that could not be read.
  if (!damage_.empty() && !(first_ && is_whole_id())) return Error{damage_};
  if (first_) return *first_;
  return Error{fmt::format("transaction {} is not there", printable(beginning_))};
}

json history_json(const std::vector<Version>& versions) {
  json all = json::array();
  for (const Version& version : versions) {
    json one{{"transaction", printable(version.tx_id())},
             {"time", time_of(version.timestamp_ns())},
             {"signer", printable(version.signer().msp_id() + " " + version.signer().subject())}};
    if (version.deleted())
      one["deleted"] = true;
    else
      one["asset"] = asset_json(version.asset());
    all.push_back(std::move(one));
  }
  return all;
}

std::string history_note(const std::string& id) {
  constexpr std::string_view control = "control/";
  if (!id.starts_with(control)) return "";
  const std::string drone = id.substr(control.size());
  return fmt::format(
      "Records of their own: stops under 'stop/{0}/*' (`ledgerline ledger get` lists them), grants under grant/{0}, "
      "requests "
      "under request/{0}.\n",
      drone);
}

std::string lines(const json& value) {
  std::string out;
  add_lines(value, 0, out);
  return out;
}

}  // namespace ledgerline::ledger
