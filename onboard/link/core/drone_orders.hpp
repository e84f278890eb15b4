#pragma once
#include "common/msg/onboard.hpp"
#include "onboard/link/core/tello/session.hpp"

namespace ledgerline::link {

/// What a drone is ordered to do besides flying plans: take off, land, stay down. Who stopped it and what clears that
/// (docs/failsafe.md), and whether it is to land. A stop stands until it is cleared by name: no plan, epoch, boot or
/// agent does that. `session` outlives it. Core: no I/O, no clock, no allocation; one thread.
class DroneOrders {
 public:
  /// `local_stop`: a local stop from an earlier link is still set. `max_wait_ns`: of a landing.
  DroneOrders(TelloSession& session, TimeNs max_wait_ns, bool local_stop) noexcept
      : session_(session), max_wait_ns_(max_wait_ns), local_stop_(local_stop) {}

  /// Why this plan's take-off is not asked for, whatever the failsafe says of it.
  DropReason takeoff_refusal(const Plan& plan) const noexcept;
  void refuse_older_takeoffs(TimeNs now) noexcept { takeoff_after_ns_ = now; }
  /// The holder's command.
  DropReason land(TimeNs now) noexcept;
  /// The failsafe's, at each step that it wants it.
  void request_landing(TimeNs now) noexcept;
  /// Whether a landing is requested that has not begun yet, and whether its time limit allows more waiting.
  bool is_landing_requested() const noexcept { return landing_requested_ns_ != 0; }
  bool may_wait_longer(TimeNs now) const noexcept { return now - landing_requested_ns_ < max_wait_ns_; }

  void stop(TimeNs now, const Plan& plan) noexcept;
  DropReason clear_stop(const Plan& plan) noexcept;
  /// The local stop key. A drone that is in the air, or was heard and may be, stays down until its stop is cleared.
  void stop_locally(TimeNs now) noexcept;
  /// Somebody at this host clears the local stop; the ledger's stands.
  void clear_local_stop() noexcept;
  /// What is cleared in the air counts from the ground on: a landing is never taken back. At every step.
  void forget_cleared_stops() noexcept;
  void on_phase(TimeNs now, LinkPhase before, LinkPhase phase) noexcept;

  bool is_stopped() const noexcept { return stop_ || local_stop_; }
  bool is_stopped_locally() const noexcept { return local_stop_; }
  bool is_cut() const noexcept { return cut_; }

 private:
  TelloSession& session_;
  TimeNs max_wait_ns_;
  /// Of a flying drone that did not begin to land yet, since another is below it (FS-64): the first request starts the
  /// time, which another one does not start again. 0: none.
  TimeNs landing_requested_ns_ = 0;
  bool stop_ = false;      ///< the ledger's
  bool local_stop_;        ///< of the local stop key, perhaps of a link before this one
  bool cut_ = false;       ///< the ledger's; in the air nobody takes it back, and it ends on the ground
  TimeNs stopped_ns_ = 0;  ///< the newest stop: a clear_stop before it clears nothing
  bool stop_cleared_ = false, local_stop_cleared_ = false;
  TimeNs takeoff_after_ns_ = 0;  ///< end of the last flight, or a stop: take-off wants a younger state
};

}  // namespace ledgerline::link
