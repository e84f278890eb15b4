#pragma once
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "ground/core/flight.hpp"

namespace ledgerline::ground {

/// The flights of a ground, one for each channel, as one: a drone is known by its place in the ground's config,
/// whatever its channel. Refers to the cores, which must outlive it. One thread, theirs.
class FlightView {
 public:
  struct DroneSlot {
    std::size_t channel = 0, drone = 0;  ///< the drone's index in that channel's core
  };

  /// One flight is its own view.
  FlightView(const FlightCore& core) : FlightView({&core}, std::vector<std::size_t>(core.drones().size())) {}
  /// `channel_of`: for each drone in the config's order; a core has its drones in the same order. At least one core.
  FlightView(std::vector<const FlightCore*> cores, const std::vector<std::size_t>& channel_of)
      : cores_(std::move(cores)), drone_of_(cores_.size()) {
    for (const std::size_t channel : channel_of) {
      slots_.push_back({channel, drone_of_[channel].size()});
      drone_of_[channel].push_back(drones_.size());
      drones_.push_back(core_of(drones_.size()).drones()[slots_.back().drone]);
    }
  }

  const std::vector<FlightDrone>& drones() const { return drones_; }
  DroneSlot slot(std::size_t drone) const { return slots_[drone]; }
  /// The other way round.
  std::size_t drone_at(DroneSlot slot) const { return drone_of_[slot.channel][slot.drone]; }
  std::size_t channels() const { return cores_.size(); }
  const FlightCore& of_channel(std::size_t channel) const { return *cores_[channel]; }

  /// The name of the drone's channel.
  const std::string& channel_of(std::size_t drone) const { return core_of(drone).config().where.channel; }

  const FlightStatus& status(std::size_t drone) const { return core_of(drone).status(slots_[drone].drone); }
  const IntakeState& intake(std::size_t drone) const { return core_of(drone).intake(slots_[drone].drone); }
  const Lease& lease(std::size_t drone) const { return core_of(drone).lease(slots_[drone].drone); }
  std::optional<CommittedPath> committed(TimeNs now_ns, std::size_t drone) const {
    return core_of(drone).committed(now_ns, slots_[drone].drone);
  }
  /// What is the same for all flights: all but drones, `where` and `trusted`.
  const FlightConfig& config() const { return cores_.front()->config(); }

  bool done() const { return all(&FlightCore::done); }
  bool ok() const { return all(&FlightCore::ok); }
  std::string why() const {
    std::string text;
    for (const FlightCore* core : cores_) {
      if (const std::string one = core->why(); !one.empty()) text += (text.empty() ? "" : "; ") + one;
    }
    return text;
  }
  TimeNs delay_ns() const {
    TimeNs delay = 0;
    for (const FlightCore* core : cores_) delay = std::max(delay, core->delay_ns());
    return delay;
  }

 private:
  const FlightCore& core_of(std::size_t drone) const { return *cores_[slots_[drone].channel]; }
  bool all(bool (FlightCore::*is)() const) const {
    return std::ranges::all_of(cores_, [&](const FlightCore* core) { return (core->*is)(); });
  }

  std::vector<const FlightCore*> cores_;
  std::vector<DroneSlot> slots_;
  std::vector<std::vector<std::size_t>> drone_of_;  ///< for each channel
  std::vector<FlightDrone> drones_;
};

}  // namespace ledgerline::ground
