#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"
#include "onboard/agent/core/control_check.hpp"

namespace ledgerline::agent {

struct CommandCheckSettings {
  std::string msp_id = "Org1MSP";  ///< our own organisation: whose endorsement counts
  fabric::ChannelAndContract where;
  TimeNs max_age_ns = 500 * ns_per_ms;
  double max_speed_mps = 8.0;  ///< a Tello's top speed in fast mode (docs/sources.md); link limits further
  double max_yaw_rate_radps = 3.5;
  TimeNs horizon_ns = contract::max_plan_ns;  ///< no setpoint is meant for later than now plus this
  std::size_t stamps_kept = 256;              ///< per drone: newest states sent; 8 s at 30 Hz
};

/// Turns blocks into plans, each of which was checked against everything in RefusalReason. The source of its blocks,
/// and the peer that ran the contract, with its real key, can delay a command, never make one: a plan is taken out of
/// the arguments under its creator's signature, and only where the event says the same. Who may command, and what is
/// stopped, ControlCheck knows.
///
// clang-format off
///     block -> chain -> flag -> channel -> signer, signature -> endorsement -> asked for
///         -+-> control event: ControlCheck; a stop also gives a plan; under a revoked lease nothing flies
///          +-> command: lease -> epoch -> boot, stamp -> sequence -> age -> limits -> Plan
// clang-format on
///
/// One thread; deterministic; memory bounded by drones × stamps_kept. The registry must outlive it.
class CommandCheck {
 public:
  CommandCheck(CommandCheckSettings settings, const std::vector<DroneName>& drones, crypto::MspRegistry& registry);

  struct Counters {
    std::uint64_t on_ledger = 0;  ///< in a block, flagged valid
    std::uint64_t verified = 0;
    std::uint64_t refused = 0;
    std::array<std::uint64_t, refusal_count> reasons{};
  };

  ControlCheck& control() { return control_; }
  const ControlCheck& control() const { return control_; }

  /// A state that was submitted: commands may answer it. Of another boot than the one before: that one's are forgotten.
  void add_sent_state(const StateSample& sample);
  /// Whether its holder may lose the drone any moment by our own doing: it does not take off then.
  void set_evicting(DroneNumber number, bool evicting);
  /// `now_s`: real time, for the certificates' validity.
  CheckedBlock check(TimeNs now, std::int64_t now_s, const fabric::Block& block);
  /// A block that the stream refused: chain and flags are ignored. Only stops are read, checked by their creators'
  /// signatures and rights.
  CheckedBlock check_refused(TimeNs now, const fabric::Block& block);

  /// The stop of which link is to know; none when the drone is not stopped.
  std::optional<Plan> standing_stop(TimeNs now, DroneNumber number) const;
  /// For a link that does not know yet that nobody has the drone stopped; none while somebody has, or without a record.
  std::optional<Plan> no_stop(TimeNs now, DroneNumber number) const;

  const Counters& counters(DroneNumber number) const;
  std::uint64_t height() const { return chain_.height(); }
  std::uint64_t broken_blocks() const { return broken_blocks_; }
  std::uint64_t unverified_transactions() const { return unverified_transactions_; }  ///< of anybody

 private:
  struct Drone {
    DroneName drone;
    std::uint64_t boot_id = 0;
    std::deque<TimeNs> stamps{};
    std::uint64_t epoch = 0, last_sequence = 0;  ///< the newest plan accepted under that epoch
    bool evicting = false;
    Counters counters{};
  };
  /// Completes the plan of a contract's action, as newer than any that link has.
  void assign_sequence(TimeNs now, Plan& plan) const;
  bool is_under_lease(const Drone& drone, const crypto::IdentityName& signer, const DronePlan& plan) const;
  void check_commands(TimeNs now, std::int64_t now_s, const fabric::Transaction& tx, CheckedBlock& out);
  RefusalReason check_whole(std::int64_t now_s, const fabric::Transaction& tx, const CheckedBlock& out,
                            access::Caller& signer) const;
  RefusalReason check_plan(TimeNs now, const Drone& drone, const crypto::IdentityName& signer,
                           const DronePlan& plan) const;
  RefusalReason check_setpoints(TimeNs now, const DronePlan& plan) const;
  bool is_within_limits(const PlannedReference& reference) const;
  static void refuse(Drone& drone, const DronePlan& plan, RefusalReason why, CheckedBlock& out);
  void refuse_altered(const fabric::Transaction& tx, CommandCall asked, CheckedBlock& out);

  CommandCheckSettings settings_;
  std::vector<Drone> drones_;
  TransactionCheck transactions_;
  ControlCheck control_;
  fabric::ChainCheck chain_;
  std::uint64_t broken_blocks_ = 0, unverified_transactions_ = 0;
};

}  // namespace ledgerline::agent
