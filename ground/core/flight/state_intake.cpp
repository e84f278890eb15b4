#include "ground/core/flight/state_intake.hpp"

#include "common/msg/ros.hpp"
#include "common/verification/calls.hpp"

namespace ledgerline::ground {
namespace {

bool is_newer(const StateSample& state, const StateSample& than) {
  return state.boot_id != than.boot_id || state.sequence > than.sequence;
}

}  // namespace

StateIntake::StateIntake(const FlightConfig& config, const LeaseBook& leases, FlightTransactions& counters)
    : config_(config), leases_(leases), counters_(counters), seen_(config.drones.size()) {}

// The contract let only the drone's owner write; this is the check that does not lean on the peer.
bool StateIntake::is_verified(const fabric::Transaction& tx, std::int64_t realtime_s, std::size_t drone) const {
  if (!config_.trusted) return true;
  const auto member = config_.trusted->member(tx.creator, realtime_s);
  const auto& owner = leases_.of(drone).owner;
  if (!member || (owner && (*member)->name != *owner)) return false;
  return fabric::verify_signature(tx, *(*member)->verifier);
}

bool StateIntake::same_boot(std::size_t drone, const StateSample& state) const {
  return seen_[drone].has_state && state.boot_id == seen_[drone].state.boot_id;
}

bool StateIntake::is_new(std::size_t drone, const StateSample& state) const {
  return !seen_[drone].has_state || is_newer(state, seen_[drone].state);
}

void StateIntake::on_block(TimeNs now) {
  for (IntakeState& seen : seen_) seen.block_ns = now;
}

void StateIntake::accept(std::size_t drone, const StateSample& state, std::optional<TimeNs> alive_ns) {
  IntakeState& seen = seen_[drone];
  seen.state = state;
  seen.state.drone = config_.drones[drone].number;
  seen.has_state = true;
  if (alive_ns) seen.received_ns = *alive_ns;
}

std::vector<StateIntake::New> StateIntake::read(const fabric::Transaction& tx, std::int64_t realtime_s,
                                                std::vector<DroneUpdate>& updates) {
  SetCall call;  // as it was signed; whatever else the event says is the peer's alone
  const verification::Match match = verification::match_set({tx.function, tx.args}, tx.event_payload, call);
  if (match != verification::Match::same) {
    ++(match == verification::Match::malformed ? counters_.malformed : counters_.altered);
    return {};
  }
  std::vector<New> states;
  std::optional<std::size_t> checked;  // the signature is checked once per drone in a row, not per asset
  std::vector<DroneUpdate> all(seen_.size());
  std::vector<std::optional<float>> charges(seen_.size());
  for (const Asset& asset : call.assets()) {
    const auto slash = asset.id().find('/');
    const auto drone = index_of(config_.drones, std::string_view(asset.id()).substr(0, slash));
    if (!drone || slash == std::string::npos) continue;
    const auto what = std::string_view(asset.id()).substr(slash + 1);
    const bool status = what == "link" && asset.msg_type() == link_status_type;
    const bool odometry = what == "odom" && asset.msg_type() == odometry_type;
    const bool battery = what == "battery" && asset.msg_type() == battery_type;
    const bool transitions = what == "failsafe" && asset.msg_type() == transitions_type;
    const bool alarm = what == "alarm" && asset.msg_type() == alarms_type;
    if (!status && !odometry && !battery && !transitions && !alarm) continue;
    if (drone != checked) {
      if (!is_verified(tx, realtime_s, *drone)) {
        ++counters_.states_unverified;
        continue;
      }
      checked = drone;
    }
    DroneUpdate& one = all[*drone];
    if (odometry) one.odometry = asset.msg_data();
    if (battery) {  // one that nobody can read is the topic's to report; NaN is unknown
      one.battery = asset.msg_data();
      const auto message = battery_from_cdr(one.battery);
      if (message && message->percentage >= 0 && message->percentage <= 1) charges[*drone] = message->percentage;
    }
    if (transitions) one.transitions = asset.msg_data();
    if (alarm) one.alarm = asset.msg_data();
    if (!status) continue;
    auto state = state_from_cdr(asset.msg_data(), one.odometry);
    if (!state) {
      ++counters_.malformed;
      continue;
    }
    StateSample& sample = state->sample;
    if (one.state ? !is_newer(sample, *one.state) : !is_new(*drone, sample)) continue;
    one.state = sample;
    one.real_ns = state->real_ns;
    states.push_back({*drone, sample});
  }
  // A charge is of the state beside it: of an older state it is old, too.
  for (auto& [drone, sample] : states) {
    if (charges[drone]) seen_[drone].battery = *charges[drone];
    if (sample.battery < 0) sample.battery = seen_[drone].battery;
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    DroneUpdate& one = all[i];
    if (one.state && one.state->battery < 0) one.state->battery = seen_[i].battery;
    one.drone = i;
    if (!one.state) one.odometry = one.battery = "";  // repeated: it only completes the batch
    if (one.state || !one.transitions.empty() || !one.alarm.empty()) updates.push_back(std::move(one));
  }
  return states;
}

}  // namespace ledgerline::ground
