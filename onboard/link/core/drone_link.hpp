#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/msg/onboard.hpp"
#include "common/rt/histogram.hpp"
#include "onboard/link/core/failsafe.hpp"
#include "onboard/link/core/link_io.hpp"
#include "onboard/link/core/playout/limiter.hpp"
#include "onboard/link/core/playout/plan_admission.hpp"
#include "onboard/link/core/playout/playout.hpp"
#include "onboard/link/core/pose/failover.hpp"
#include "onboard/link/core/pose/odometry.hpp"
#include "onboard/link/core/pose/source_check.hpp"
#include "onboard/link/core/separation/landing_wait.hpp"
#include "onboard/link/core/separation/separation.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/session.hpp"
#include "onboard/link/core/transition_log.hpp"
#include "onboard/link/core/velocity.hpp"
#include "onboard/link/core/watch/battery_watch.hpp"
#include "onboard/link/core/watch/client_watch.hpp"
#include "onboard/link/core/watch/flow_watch.hpp"
#include "onboard/link/core/watch/heat_watch.hpp"
#include "onboard/link/core/watch/motion_watch.hpp"
#include "onboard/link/core/watch/tilt_watch.hpp"

namespace ledgerline::link {

/// Figures of one drone since the start.
struct DroneReport {
  std::string name;
  DroneNumber number = 0;
  std::uint64_t states_sampled = 0;
  PlanCounters plans;
  TransitionLog::Counters transitions;
  Quantiles age_ms;     ///< at application: sent - the state's stamp
  bool heard = false;   ///< anything at all came from it
  bool landed = false;  ///< it flew and is on the ground again
  FlightPhase phase = FlightPhase::disconnected;
};

/// What all drones share in a step of link.
struct LinkMoment {
  TimeNs now;
  bool healthy;  ///< steps come in time, and have for LinkSettings::health_rest_ns
  /// The host was suspended before: what is stamped earlier is older than it says. 0: it was not.
  TimeNs not_before_ns = 0;
  bool stop_all;  ///< the local stop key was pressed
  LinkOutputs& out;
};

/// One drone as link flies it: its plans go through the admission into the playout, the playout's setpoint through
/// failsafe, fence and limits into `rc`; its session says where the flight is. In a step first what came is taken, then
/// step() is called once, then sample() if it is time for one. Does not move: playout holds on to the admission. Core:
/// no I/O, no clock, no allocation after construction; one thread.
class DroneLink {
 public:
  /// `local_stop`: one of a link before this one stands.
  DroneLink(const DroneSettings& drone, const LinkSettings& settings, std::uint64_t boot_id, bool local_stop);
  DroneLink(const DroneLink&) = delete;
  DroneLink& operator=(const DroneLink&) = delete;

  void take_bytes(TimeNs now, Port port, std::string_view bytes) noexcept;
  /// Stamps never go back and are not of the future: LinkCore passes on no other. A pose counts where motion capture is
  /// the source.
  void take_heartbeat(const AgentHeartbeat& heartbeat) noexcept;
  void take_pose(TimeNs now, const Pose& pose) noexcept;
  void take_plan(const LinkMoment& at, const Plan& plan) noexcept;
  /// The local stop key. A drone that is in the air, or was heard and may be, stays down until its stop is cleared.
  void stop_locally(TimeNs now) noexcept;
  /// Somebody at this host clears the local stop; the ledger's stands.
  void clear_local_stop() noexcept;
  bool stopped_locally() const noexcept { return local_stop_; }
  /// Link was started too often: `land` is said again to a drone that is not seen.
  void land_again(TimeNs now) noexcept { session_.land_again(now, LostLinkProtocol::Requester::local); }
  /// The clock stood still for `slept_ns` while time passed: plans and poses in hand are that much older.
  void grow_older(TimeNs now, TimeNs slept_ns) noexcept;
  /// Time passed: without a pose (agent died, its plan is flown to the end) the fence still needs to know about where
  /// the drone is.
  void dead_reckon(double seconds) noexcept;
  /// What the others must know of it, and its setpoint; false: it has no place among them, or none that is known.
  bool among_others(TimeNs now, Neighbour& out) noexcept;
  /// What it may fly of that, before step().
  void take_verdict(const Verdict& verdict) noexcept { verdict_ = verdict; }
  void step(const LinkMoment& at) noexcept;
  void sample(const LinkMoment& at) noexcept;
  /// Ends all plans that still wait.
  void finish() noexcept { playout_.clear(DropReason::superseded); }

  DroneNumber number() const noexcept { return number_; }
  FlightPhase phase() const noexcept { return session_.phase(); }
  const Pose& pose() const noexcept { return pose_; }
  FailsafeMode mode() const noexcept { return failsafe_.mode; }
  TimeNs margin_ns() const noexcept { return playout_.margin_ns(); }
  /// The heading by which velocities of the map become rc.
  double yaw_rad(TimeNs now) const noexcept;
  /// It is in the air, or nobody knows that it is not.
  bool may_fly() const noexcept { return in_flight(session_.phase()) || session_.may_be_airborne(); }
  bool heard() const noexcept { return session_.heard(); }
  bool commanded_to_land(TimeNs now) const noexcept { return session_.commanded_to_land(now); }
  /// It is flown to make room for another, not by a plan: it steps aside while it holds, or waits to land.
  bool makes_room() const noexcept;
  DroneReport report() const;

 private:
  void take_state(TimeNs now, const TelloState& state) noexcept;
  /// Holds motion capture against the odometry, which took this text.
  void check_sources(TimeNs now, const TelloState& state) noexcept;
  void accept_pose(TimeNs now, const Pose& pose) noexcept;
  /// Its position comes from onboard odometry.
  bool is_by_odometry() const noexcept;
  Velocity in_map(const Playout::CurrentSetpoint& setpoint, TimeNs now) const noexcept;
  /// Why a plan to fly is not taken; none: it may be flown.
  DropReason may_follow(const LinkMoment& at, const Plan& plan) const noexcept;
  /// Does what any other plan asks for; none: done, or it was so already.
  DropReason obey(const LinkMoment& at, const Plan& plan) noexcept;
  DropReason take_off(const LinkMoment& at, const Plan& plan) noexcept;
  DropReason land(TimeNs now) noexcept;
  void stop(TimeNs now, const Plan& plan) noexcept;
  DropReason clear_stop(const Plan& plan) noexcept;
  void forget_cleared_stops() noexcept;
  void update_facts(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint) noexcept;
  /// What it feels of itself; `placed`: a pose says where it is.
  void update_sensing(TimeNs now, bool placed) noexcept;
  /// Since when its position comes from onboard odometry alone; 0: it does not.
  TimeNs alone_since_ns(TimeNs now) const noexcept;
  /// Of its plans; while a landing waits: downward.
  Playout::CurrentSetpoint desired_setpoint(TimeNs now) noexcept;
  /// Another is below the drone that is to land, link can still steer it, and its time is not over.
  bool landing_waits(const LinkMoment& at) const noexcept;
  /// What of a setpoint may be flown, as the verdict says.
  Velocity left_by_others(Velocity desired) const noexcept;
  bool too_near() const noexcept;
  void obey_failsafe(TimeNs now) noexcept;
  /// A hold with a usable position gets out of the wash of another that hovers above or below.
  bool steps_aside() const noexcept;
  /// The newest pose is young enough to be steered by.
  bool placed(TimeNs now) const noexcept;
  void talk(const LinkMoment& at) noexcept;
  void fly(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint) noexcept;
  void send_rc(const LinkMoment& at, const Velocity& sent, const Rc& rc) noexcept;
  void watch_phase(const LinkMoment& at) noexcept;
  void record_transition(const LinkMoment& at) noexcept;
  void record_applied(const LinkMoment& at, std::uint64_t sequence, TimeNs state_stamp_ns, TimeNs late_ns) noexcept;
  void record_ends(const LinkMoment& at) noexcept;
  void report_serial(const LinkMoment& at) noexcept;

  std::string name_;
  DroneNumber number_;
  std::uint64_t boot_id_;
  FailsafeSettings failsafe_settings_;
  FenceSettings fence_;
  RcSettings rc_settings_;

  PoseSource source_;
  bool by_hand_without_pose_;
  Odometry odometry_;  ///< onboard: the source of its pose, or what motion capture is checked against
  bool velocity_known_;
  SourceCheck source_check_;
  Failover failover_;              ///< where they stand in for motion capture
  Pose mocap_pose_;                ///< the newest of motion capture
  std::vector<PadSettings> pads_;  ///< none where they are not the source
  TiltWatch tilt_watch_;
  MotionWatch motion_watch_;
  FlowWatch flow_watch_;
  BatteryWatch battery_watch_;
  HeatWatch heat_watch_;
  ClientWatch client_watch_;

  TelloSession session_;
  PlanAdmission admission_;
  Playout playout_;
  Limiter limiter_;
  FailsafeState failsafe_;
  FailsafeFacts facts_;
  TransitionLog transitions_;

  Pose pose_;                                             ///< fence and separation go by it
  Pose published_pose_;                                   ///< the same for its pilot, which never jumps
  std::array<double, 3> moved_m_{};                       ///< since that pose, as far as what was sent tells
  double drone_yaw_rad_ = 0, drone_yaw_at_pose_rad_ = 0;  ///< the drone's own, newest and at that pose
  bool by_hand_ = false;  ///< the newest plan that was to be flown is in the drone's frame
  TimeNs pose_came_ns_ = 0;
  bool in_common_frame_;
  std::optional<Verdict> verdict_;  ///< of this step; none: it is alone
  LandingWait landing_;
  FenceSettings drawn_fence_;  ///< as it held in the last step that flew
  // Each stands until it is cleared by name: no plan, epoch, boot or agent does that.
  bool stop_ = false;      ///< the ledger's
  bool local_stop_;        ///< of the local stop key, perhaps of a link before this one
  bool cut_ = false;       ///< the ledger's; in the air nobody takes it back, and it ends on the ground
  TimeNs stopped_ns_ = 0;  ///< the newest stop: a clear_stop before it clears nothing
  // What was cleared in the air counts from the ground on: a landing is never taken back.
  bool stop_cleared_ = false, local_stop_cleared_ = false;
  TimeNs takeoff_after_ns_ = 0;  ///< end of the last flight, or a stop: take-off wants a younger state

  FlightPhase last_phase_ = FlightPhase::disconnected;  ///< what the trace got last
  FailsafeMode last_mode_ = FailsafeMode::none;
  FailsafeCause last_cause_ = FailsafeCause::none;
  Transition last_transition_;

  SerialCheck::Verdict logged_serial_ = SerialCheck::Verdict::unwanted;

  TimeNs last_rc_ns_ = 0;
  Rc last_rc_{};
  Velocity sent_;  ///< as sent to the drone, after limits, failsafe and rc's range

  std::uint64_t states_sampled_ = 0;
  std::uint64_t applied_sequence_ = 0;
  std::uint64_t arrived_sequence_ = 0;
  TimeNs arrived_ns_ = 0;
  Histogram age_;
};

}  // namespace ledgerline::link
