#include "hil/sitl/ledger/stoppers.hpp"

#include <algorithm>

#include "common/access/access.hpp"
#include "common/msg/contract.hpp"
#include "hil/sitl/world_setup.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::hil {

Stoppers::Stoppers(SimulatedLedger& ledger, LedgerPort& operating, std::uint64_t seed)
    : ledger_(ledger), operating_(operating), seed_(seed) {}

LedgerPort& Stoppers::port(Stopper who) {
  if (who == Stopper::operating) return operating_;
  auto& port = ports_[who];
  if (!port) {
    const auto& name = who == Stopper::supervisor ? supervisor_name
                       : who == Stopper::outsider ? outsider_name
                                                  : administrator_name;
    port = std::make_unique<LedgerPort>(ledger_, name, ++seed_);
  }
  return *port;
}

namespace {

fabric::Call call_of(const std::string& drone, ControlCommand word) {
  if (word == ControlCommand::acquire || word == ControlCommand::claim || word == ControlCommand::request) {
    LeaseCall call;
    call.add_drones(drone);
    if (word != ControlCommand::claim) call.set_priority(contract::max_priority);
    return {word == ControlCommand::request ? contract::request : contract::acquire, {call.SerializeAsString()}};
  }
  if (word == ControlCommand::hand_over || word == ControlCommand::deny) {
    AnswerCall call;
    call.add_drones(drone);
    *call.mutable_to() = to_message(supervisor_name);
    return {word == ControlCommand::deny ? contract::deny : contract::hand_over, {call.SerializeAsString()}};
  }
  if (word == ControlCommand::revoke) {
    RevokeCall call;
    *call.mutable_identity() = to_message(operator_name);
    return {contract::revoke, {call.SerializeAsString()}};
  }
  DronesCall call;
  call.add_drones(drone);
  call.set_cut(word == ControlCommand::cut);
  const bool stops = word == ControlCommand::stop || word == ControlCommand::cut;
  return {stops                                ? contract::stop
          : word == ControlCommand::clear_stop ? contract::clear_stop
                                               : contract::evict,
          {call.SerializeAsString()}};
}

}  // namespace

void Stoppers::post(TimeNs now, Stopper who, const std::string& drone, ControlCommand word) {
  fabric::RepeatLimits limits;
  fabric::Call call = call_of(drone, word);
  if (call.function != contract::stop) limits = {.attempts = 10, .conflicts_only = true};
  calls_.push_back({who, std::move(call), fabric::Repeat(limits, ++seed_, now), now, 0});
}

void Stoppers::ended(TimeNs now, std::size_t at, const fabric::Outcome& outcome) {
  PendingCall& pending = calls_[at];
  pending.id = 0;
  if (pending.repeat.ended(now, outcome) == fabric::Repeat::Next::again) {
    pending.next_ns = pending.repeat.at_ns();
  } else {
    calls_.erase(calls_.begin() + static_cast<std::ptrdiff_t>(at));
  }
}

bool Stoppers::on_outcome(TimeNs now, const SimulatedLedger::Ended& outcome) {
  const auto pending =
      std::find_if(calls_.begin(), calls_.end(), [&](const PendingCall& s) { return s.id == outcome.id; });
  if (outcome.id == 0 || pending == calls_.end()) return outcome.id > (std::uint64_t{1} << 62);
  ended(now, static_cast<std::size_t>(pending - calls_.begin()), outcome.outcome);
  return true;
}

void Stoppers::forgotten(TimeNs now) {
  fabric::Outcome outcome;
  outcome.message = "the connection broke";
  for (std::size_t at = calls_.size(); at-- > 0;) {
    if (calls_[at].who == Stopper::operating && calls_[at].id != 0) ended(now, at, outcome);
  }
}

void Stoppers::restart(TimeNs now) {
  for (auto& [who, port] : ports_) port->restart(now);
}

void Stoppers::step(TimeNs now) {
  for (auto& [who, port] : ports_) {
    port->step(now);
    (void)port->pop_blocks();
    for (const auto& outcome : port->pop_outcomes()) on_outcome(now, outcome);
  }
  for (PendingCall& pending : calls_) {
    if (pending.id != 0 || now < pending.next_ns) continue;
    pending.id = ++last_id_;
    port(pending.who).submit(now, pending.id, pending.call);
  }
}

}  // namespace ledgerline::hil
