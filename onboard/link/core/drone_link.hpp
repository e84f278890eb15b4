#pragma once
#include <cstdint>
#include <optional>
#include <string_view>

#include "common/msg/onboard.hpp"
#include "onboard/link/core/drone_orders.hpp"
#include "onboard/link/core/drone_reporting.hpp"
#include "onboard/link/core/drone_watches.hpp"
#include "onboard/link/core/failsafe.hpp"
#include "onboard/link/core/link_io.hpp"
#include "onboard/link/core/playout/playout.hpp"
#include "onboard/link/core/playout/setpoint_path.hpp"
#include "onboard/link/core/pose/drone_position.hpp"
#include "onboard/link/core/separation.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/session.hpp"
#include "onboard/link/core/track/tracker.hpp"

namespace ledgerline::link {

/// One drone as link flies it. Each of its parts has one job; this class hands them what came, and asks the failsafe
/// once a step what to do. In a step: what came, step(), then sample() if it is time for one. Does not move: its parts
/// hold on to each other. Core: no I/O, no clock, no allocation after construction; one thread.
class DroneLink {
 public:
  /// `local_stop`: a local stop from an earlier link is still set.
  DroneLink(const DroneSettings& drone, const LinkSettings& settings, std::uint64_t boot_id, bool local_stop);
  DroneLink(const DroneLink&) = delete;
  DroneLink& operator=(const DroneLink&) = delete;

  void on_bytes(TimeNs now, Port port, std::string_view bytes) noexcept;
  /// Stamps neither go back nor are of the future (LinkCore). A pose counts where motion capture is the source.
  void on_heartbeat(const AgentHeartbeat& heartbeat) noexcept;
  void on_pose(TimeNs now, const Pose& pose) noexcept;
  void on_plan(const LinkMoment& at, const Plan& plan) noexcept;
  /// Link was started too often: `land` is said again to a drone that is not seen.
  void land_again(TimeNs now) noexcept { session_.land_again(now, LostLinkProtocol::Requester::local); }
  /// The clock stood still for `slept_ns` while time passed: plans and poses in hand are that much older.
  void grow_older(TimeNs now, TimeNs slept_ns) noexcept;
  void dead_reckon(double seconds) noexcept { position_.dead_reckon(seconds, setpoints_.sent()); }
  /// What the others must know of it, and its setpoint; none: it has no place among them, or none that is known.
  std::optional<Neighbour> as_neighbour(TimeNs now) noexcept;
  /// What it may fly of that, before step(); none: it is alone.
  void set_clearance(const std::optional<Clearance>& clearance) noexcept { setpoints_.set_clearance(clearance); }
  void step(const LinkMoment& at) noexcept;
  void sample(const LinkMoment& at) noexcept;
  void finish() noexcept { setpoints_.drop_plans(DropReason::superseded); }

  DroneOrders& orders() noexcept { return orders_; }
  const DroneOrders& orders() const noexcept { return orders_; }
  const DronePosition& position() const noexcept { return position_; }
  const TelloSession& session() const noexcept { return session_; }
  DroneNumber number() const noexcept { return number_; }
  FailsafeMode mode() const noexcept { return failsafe_.mode; }
  TimeNs margin_ns() const noexcept { return setpoints_.margin_ns(); }
  /// It is flown to make room for another, not by a plan: it steps aside while it holds, or waits to land.
  bool makes_room() const noexcept;
  DroneReport report() const { return reporting_.report(session_, admission_.counters()); }

 private:
  /// Why a plan to fly is not taken; none: it may be flown.
  DropReason may_follow(const LinkMoment& at, const Plan& plan) const noexcept;
  /// Does what any other plan asks for; none: done, or it was so already.
  DropReason obey(const LinkMoment& at, const Plan& plan) noexcept;
  DropReason take_off(const LinkMoment& at, const Plan& plan) noexcept;
  void update_inputs(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint) noexcept;
  /// Without a pose its own height is all that is known of where it is.
  void place_by_height() noexcept;
  Neighbour::Kind kind_as_neighbour(bool is_steered) const noexcept;
  /// Another is below the drone that is to land, link can still steer it, and its time is not over.
  bool should_delay_landing(const LinkMoment& at) const noexcept;
  bool is_too_near() const noexcept;
  void obey_failsafe(TimeNs now) noexcept;
  /// A hold with a usable position gets out of the wash of another that hovers above or below.
  bool steps_aside() const noexcept { return failsafe_.mode == FailsafeMode::hold && setpoints_.should_step_aside(); }
  /// The newest pose is young enough to be steered by.
  bool is_placed(TimeNs now) const noexcept;
  /// Half of that: one that may be missing is not corrected by.
  bool is_freshly_placed(TimeNs now) const noexcept;
  void send_commands(const LinkMoment& at) noexcept;
  void fly(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint) noexcept;
  /// Link may correct where it flies: it has a pose, its failsafe lets it fly or hover, and it answers as drones do.
  bool may_track(TimeNs now) const noexcept;
  float push_mps(TimeNs now) const noexcept;
  /// In the map, before the other drones and the fence: what a setpoint wants, held on board; else to stay.
  Velocity velocity_for(TimeNs now, const Playout::CurrentSetpoint& setpoint, bool follows) noexcept;
  void watch_phase(const LinkMoment& at) noexcept;

  DroneNumber number_;
  FailsafeSettings failsafe_settings_;
  FenceSettings fence_;
  TrackSettings track_settings_;
  bool by_hand_without_pose_;
  bool in_common_frame_;
  TelloSession session_;
  DronePosition position_;
  DroneWatches watches_;
  DroneOrders orders_;
  PlanAdmission admission_;
  SetpointPath setpoints_;
  Tracker tracker_;
  FailsafeState failsafe_;
  FailsafeInputs inputs_;
  DroneReporting reporting_;
  LinkPhase last_phase_ = LinkPhase::disconnected;
};

}  // namespace ledgerline::link
