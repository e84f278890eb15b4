#pragma once
#include <vector>

#include "ground/core/lease/lease_book.hpp"

namespace ledgerline::ground {

/// What is known of a drone.
struct IntakeState {
  StateSample state;
  bool has_state = false;
  float battery = -1;      ///< the newest that was sent; below 0: none yet
  TimeNs received_ns = 0;  ///< when a state came that counts as a sign of life; the ground's clock
  TimeNs block_ns = 0;     ///< likewise the channel's newest block, whatever is in it
};

/// States out of batches: only what the drone's host signed, only of drones that fly here, only what is newer than the
/// newest, or of another boot. A batch repeats the last values of drones without new ones; these are ignored. In a call
/// a drone's odometry and battery stand before its status, as agent writes them. What is refused is counted.
/// Deterministic; one thread.
class StateIntake {
 public:
  struct New {
    std::size_t drone = 0;
    StateSample state;
  };

  StateIntake(const FlightConfig& config, const LeaseBook& leases, FlightTransactions& counters);

  /// The states of a `set` in their order, not accepted yet; `updates`: what to publish.
  std::vector<New> read(const fabric::Transaction& tx, std::int64_t realtime_s, std::vector<DroneUpdate>& updates);
  bool is_new(std::size_t drone, const StateSample& state) const;
  bool same_boot(std::size_t drone, const StateSample& state) const;
  /// From now on the drone's newest. `alive_ns`: it is a sign of life.
  void accept(std::size_t drone, const StateSample& state, std::optional<TimeNs> alive_ns);
  /// To be called for each block.
  void on_block(TimeNs now);
  /// The reference stays valid as long as this object.
  const IntakeState& of(std::size_t drone) const { return seen_[drone]; }

 private:
  bool is_verified(const fabric::Transaction& tx, std::int64_t realtime_s, std::size_t drone) const;

  const FlightConfig& config_;
  const LeaseBook& leases_;
  FlightTransactions& counters_;
  std::vector<IntakeState> seen_;
};

}  // namespace ledgerline::ground
