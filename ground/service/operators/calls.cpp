#include "ground/service/operators/calls.hpp"

#include <fmt/format.h>

#include <array>

#include "common/access/access.hpp"
#include "common/base/enum_count.hpp"
#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground::service {
namespace {

struct Row {
  const char* function;
  const char* words;
};
constexpr std::array rows{
    Row{contract::acquire, "take control"},    Row{contract::release, "give back"},
    Row{contract::request, "ask for control"}, Row{contract::hand_over, "hand over"},
    Row{contract::deny, "deny the request"},   Row{contract::clear_stop, "clear the stop"},
    Row{contract::anchor, "approve"},          Row{contract::anchor, "withdraw the approval of"},
};
static_assert(rows.size() == enum_count<OperatorCall::Kind>);

const Row& row_of(OperatorCall::Kind kind) { return rows[static_cast<std::size_t>(kind)]; }

}  // namespace

fabric::Call anchor_call(const crypto::Digest& digest, const std::string& what) {
  AnchorCall call;
  call.set_digest(std::string(digest.begin(), digest.end()));
  call.set_what(what);
  return {contract::anchor, {call.SerializeAsString()}};
}

std::string words_of(const OperatorCall& call) {
  const std::string words = row_of(call.kind).words;
  return call.mission.empty() ? words : words + " mission " + call.mission;
}

fabric::Call contract_call(const OperatorCall& call, const std::string& drone, const crypto::IdentityName& commander) {
  using Kind = OperatorCall::Kind;
  const auto as_call = [&](const auto& message) {
    return fabric::Call{row_of(call.kind).function, {message.SerializeAsString()}};
  };
  if (call.kind == Kind::hand_over || call.kind == Kind::deny) {
    AnswerCall answer;
    answer.add_drones(drone);
    *answer.mutable_to() = to_message(call.to);
    return as_call(answer);
  }
  if (call.kind == Kind::clear_stop) {
    DronesCall drones;
    drones.add_drones(drone);
    return as_call(drones);
  }
  if (call.kind == Kind::approve || call.kind == Kind::withdraw) return anchor_call(call.digest, call.what);
  LeaseCall lease;
  lease.add_drones(drone);
  lease.set_priority(call.priority);
  if (call.kind != Kind::release) *lease.mutable_delegate() = to_message(commander);
  return as_call(lease);
}

Status check_key(const OperatorKeyState& key, OperatorCall::Kind kind) {
  if (key.unlocked && (!key.left || kind == OperatorCall::Kind::release)) return done;
  return Error{"the session is over"};
}

bool may_clear_ground_stop(const fabric::Outcome& outcome, const std::string& drone) {
  return outcome.refusal && outcome.refusal->about == drone;
}

CallUpdate update_of(const std::string& name, const OperatorCall& call, const std::string& why) {
  return {Level::warning, fmt::format("{}: {}: not signed: {}", name, words_of(call), why)};
}

CallUpdate update_of(const std::string& name, const OperatorCall& call, const fabric::Outcome& outcome) {
  const std::string what = fmt::format("{}: {}", name, words_of(call));
  if (outcome.kind == fabric::Outcome::Kind::committed) return {Level::info, what};
  return {Level::warning,
          fmt::format("{}: refused: {}", what, outcome.refusal ? outcome.refusal->words : outcome.message)};
}

}  // namespace ledgerline::ground::service
