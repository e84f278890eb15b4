#include "ground/core/flight/phases.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/access/access.hpp"
#include "common/access/grants.hpp"
#include "common/access/stops.hpp"
#include "common/msg/names.hpp"

namespace ledgerline::ground {
namespace {

constexpr TimeNs grounded_for_ns = 2 * ns_per_s;  // a take-off command may still be in flight
constexpr TimeNs refused_for_ns = 2 * ns_per_s;   // link takes no older plan, so what came by then was this take-off
constexpr TimeNs end_wait_ns = 3 * ns_per_s;      // for the drone to come up to the path's end

constexpr const char* by_itself = "came down by itself";

std::string revoked_words(const Lease& lease) {
  return is_revoked(*lease.record, lease.record->holder())
             ? fmt::format("its operator {} is revoked", lease.holder->subject)
             : fmt::format("{}, who commands it, is revoked", lease.commander->subject);
}

/// Why it flies no more; `how`: what its failsafe did, where that had a cause.
std::string came_down(const StateSample& s, const char* how) {
  if (s.cause == FailsafeCause::none)
    return "landed without an order of ours: another client's (`ledgerline tello land`), or its firmware did";
  if (s.cause == FailsafeCause::state_stale)  // nobody has seen it come down
    return fmt::format("lost: link had no more state of it, last at {:.2f}, {:.2f}, {:.2f} m", s.position_m[0],
                       s.position_m[1], s.position_m[2]);
  return fmt::format("{}: {}", how, words_for(s.cause));
}

Status named(const char* what, const Status& checked) {
  return checked ? checked : Status(Error{what + checked.error().message});
}

}  // namespace

bool may_take_off(const StateSample& state, bool manual) {
  switch (state.cause) {
    case FailsafeCause::none:
    case FailsafeCause::stopped:
    case FailsafeCause::takeoff_refused_by_drone:  // it may accept the next one
      return true;
    case FailsafeCause::pose_lost:
    case FailsafeCause::velocity_lost:
    case FailsafeCause::height_lost:
    case FailsafeCause::position_uncertain:
      return manual;  // a pilot sees where it is
    default:
      return false;
  }
}

void Phases::enter(TimeNs now, GroundPhase phase) {
  status_.phase = phase;
  entered_ns_ = now;
  status_.paused = false;
  if (phase != GroundPhase::takeoff && phase != GroundPhase::path) status_.planned.clear();
}

void Phases::clear_why() {
  status_.why.clear();
  status_.landed_by_stop = false;
}

void Phases::land(TimeNs now, const std::string& why, bool by_stop) {
  if (status_.phase >= GroundPhase::landing) return;
  end_path();
  if (status_.why.empty()) {
    status_.why = why;
    status_.landed_by_stop = by_stop;
  }
  enter(now, status_.phase == GroundPhase::waiting ? GroundPhase::failed : GroundPhase::landing);
}

Status Phases::land_by_pilot(TimeNs now, const std::string& why, bool by_stop) {
  // A flight along a path that waits would take off as soon as nothing speaks against it.
  const bool waits_to_fly = status_.phase == GroundPhase::waiting && !config_.manual;
  if (in_air() || waits_to_fly) land(now, why, by_stop);
  if (status_.phase == GroundPhase::failed && seen_.has_state && is_in_flight(seen_.state.phase))
    enter(now, GroundPhase::landing);
  if (status_.phase != GroundPhase::waiting) return done;
  const Status ready = check_ready(now);
  return ready ? Status(Error{"it is on the ground"}) : ready;
}

void Phases::end_path() {
  if (status_.phase == GroundPhase::path || status_.phase == GroundPhase::manual)
    status_.path_ns[1] = seen_.state.stamp_ns;
}

void Phases::lease_changed(TimeNs now) {
  if (config_.manual && status_.phase == GroundPhase::waiting && lease_.may_command) clear_why();
  if (!in_air()) return;
  if (is_stopped(lease_.stoppers)) {
    land(now, "stopped by " + stopper_names(lease_.stoppers), true);
  } else if (lease_.commander != config_.self || lease_.revoked) {
    end_path();
    status_.why = lease_.commander != config_.self
                      ? "lost its lease" + (lease_.holder ? " to " + holder_words(lease_) : "")
                      : revoked_words(lease_);
    const bool ourselves = lease_.revoked && is_revoked(*lease_.record, to_message(config_.self));
    // Handed back, or held by another one who lets us command, its pilot flies it on.
    enter(now, config_.manual && !ourselves ? GroundPhase::waiting : GroundPhase::failed);
  }
}

Status Phases::take_off(TimeNs now, bool ending) {
  Status ready = check_ready(now);
  if (status_.phase == GroundPhase::landing) ready = Error{"it is landing"};
  if (ending) ready = Error{"the flight is ending"};
  if (in_air()) ready = Error{"it is in the air"};
  if (!config_.manual) ready = Error{"it flies a path"};
  if (!ready) return ready;
  flew_ = false;
  planner_.manual().release();
  clear_why();
  status_.origin_m = {seen_.state.position_m[0], seen_.state.position_m[1]};
  origin_known_ = check_pose(now).ok();
  asked_ns_ = seen_.state.stamp_ns;
  refused_before_ = seen_.state.cause == FailsafeCause::takeoff_refused_by_drone;
  enter(now, GroundPhase::takeoff);
  return done;
}

// Whether a pilot may do without a pose only link's config knows: it is asked, and what it makes of that is seen.
Status Phases::check_takeoff(TimeNs now) {
  const StateSample& s = seen_.state;
  const bool stands = s.phase == LinkPhase::on_ground || s.phase == LinkPhase::landed;
  const bool refused = s.cause == FailsafeCause::takeoff_refused_by_drone;
  refused_before_ = refused_before_ && refused;
  if (status_.phase != GroundPhase::takeoff || !config_.manual || flew_ || !stands) return done;
  if (refused && !refused_before_) {
    enter(now, GroundPhase::waiting);
    return Error{words_for(s.cause)};
  }
  if (may_take_off(s, false) || s.arrived_ns - asked_ns_ < refused_for_ns) return done;
  enter(now, GroundPhase::waiting);
  const bool of_pose = s.cause == FailsafeCause::pose_lost || s.cause == FailsafeCause::position_uncertain;
  return Error{fmt::format("link refuses it ({}{})", words_for(s.cause),
                           of_pose ? "; where its by_hand_without_pose is set a pilot does without" : "")};
}

bool Phases::near_origin() const {
  const auto& s = seen_.state;
  return std::hypot(s.position_m[0] - status_.origin_m[0], s.position_m[1] - status_.origin_m[1]) < near_m;
}

bool Phases::settled() const {
  return is_settled(seen_.state, {status_.origin_m[0], status_.origin_m[1], planner_.follower()->start_height_m()});
}

void Phases::advance(TimeNs now, TimeNs delay_ns) {
  const StateSample& s = seen_.state;
  const bool grounded = s.phase == LinkPhase::on_ground || s.phase == LinkPhase::landed;
  switch (status_.phase) {
    case GroundPhase::waiting:
      return advance_waiting(now);
    case GroundPhase::takeoff:
      return advance_takeoff(now, delay_ns);
    case GroundPhase::path:
    case GroundPhase::manual:
      return advance_flown(now);
    case GroundPhase::landing:
      if (grounded && (flew_ || now - entered_ns_ > grounded_for_ns)) enter(now, GroundPhase::landed);
      return;
    case GroundPhase::landed:
    case GroundPhase::failed:
      return;
  }
}

void Phases::advance_waiting(TimeNs now) {
  const StateSample& s = seen_.state;
  const bool grounded = s.phase == LinkPhase::on_ground || s.phase == LinkPhase::landed;
  const bool flying = s.phase == LinkPhase::flying;
  if (config_.manual) {
    // Found in the air, it is held there: see takeoff.
    if (!flying || !check_ready(now)) return;
    origin_known_ = false;
    enter(now, GroundPhase::takeoff);
    return;
  }
  if (!lease_.may_command || s.pose_stamp_ns == 0 || !(grounded || flying)) return;
  if (grounded && (!may_take_off(s, config_.manual) || !timing_.check_delay())) return;
  status_.origin_m = {s.position_m[0], s.position_m[1]};
  if (const Status begun = planner_.begin_path(status_.origin_m, s.yaw_rad); !begun) {
    status_.why = begun.error().message;
    enter(now, GroundPhase::failed);
    return;
  }
  enter(now, GroundPhase::takeoff);
}

void Phases::advance_takeoff(TimeNs now, TimeNs delay_ns) {
  const StateSample& s = seen_.state;
  if (s.phase != LinkPhase::flying) {
    if (flew_) land(now, came_down(s, by_itself));
    return;
  }
  if (!flew_) settling_since_ns_ = s.stamp_ns;
  flew_ = true;
  if (config_.manual) {
    status_.path_ns = {s.stamp_ns, 0};
    enter(now, GroundPhase::manual);
  } else if (settled()) {
    path_since_ns_ = status_.path_ns[0] = s.stamp_ns + delay_ns;
    planner_.start_path(path_since_ns_);
    enter(now, GroundPhase::path);
  } else if (s.stamp_ns - settling_since_ns_ > config_.limits.settle_ns) {
    land(now,
         fmt::format("did not settle above where it took off within {:.0f} s", to_seconds(config_.limits.settle_ns)));
  }
}

void Phases::advance_flown(TimeNs now) {
  const StateSample& s = seen_.state;
  if (s.phase != LinkPhase::flying) {
    land(now, came_down(s, by_itself));
  } else if (s.mode == FailsafeMode::land || s.mode == FailsafeMode::cut) {
    land(now, came_down(s, "its failsafe landed it"));
  } else if (status_.phase == GroundPhase::path) {
    config_.manual ? advance_pilot_path(now) : advance_path(now);
  }
}

void Phases::advance_path(TimeNs now) {
  const StateSample& s = seen_.state;
  const Follower& follower = *planner_.follower();
  if (config_.seconds > 0) {
    const double share = to_seconds(s.stamp_ns - path_since_ns_) / config_.seconds;
    status_.progress = std::clamp(share, 0.0, 1.0);
    status_.finished = share >= 1;
  } else {
    status_.progress = follower.progress_m() / (planner_.laps() * follower.lap_m());
    if (follower.at_end()) {
      if (end_since_ns_ == 0) end_since_ns_ = s.stamp_ns;
      status_.finished = near_origin();
      if (!status_.finished && s.stamp_ns - end_since_ns_ > end_wait_ns) land(now, "did not reach the end of its path");
    }
  }
  if (!status_.finished) return;
  end_path();
  enter(now, GroundPhase::landing);
}

void Phases::advance_pilot_path(TimeNs now) {
  const Follower& follower = *planner_.follower();
  const PilotPath& path = *planner_.pilot_path();
  const double end_m = path.end_m(follower);
  status_.progress = end_m > 0 ? std::clamp(follower.progress_m() / end_m, 0.0, 1.0) : 1;
  status_.reached = path.reached();
  if (!path.at_end(follower, seen_.state)) return;
  status_.reached = path.reached() + 1;
  if (path.land_behind()) {
    land(now, "");
  } else {
    enter(now, GroundPhase::manual);
  }
}

TimeNs Phases::path_limit_ns() const {
  constexpr double spare_s = 30;
  if (config_.manual) return from_seconds(config_.limits.path_factor * planner_.follower()->expected_s(1) + spare_s);
  if (config_.seconds > 0) return from_seconds(config_.seconds + spare_s);
  return from_seconds(config_.limits.path_factor * planner_.follower()->expected_s(planner_.laps()) + spare_s);
}

Status Phases::check_ready(TimeNs now) const {
  if (!seen_.has_state) return Error{"no state came through the ledger"};
  if (is_stopped(lease_.stoppers)) return Error{"it is stopped by " + stopper_names(lease_.stoppers)};
  if (!lease_.may_command)
    return Error{lease_.holder ? "its lease is held by " + holder_words(lease_) : "nobody holds its lease"};
  // It may have been switched off, or taken off by another, since.
  if (now - seen_.received_ns > config_.limits.silence_ns) return Error{silence_words(now, config_.limits.silence_ns)};
  if (seen_.state.pose_stamp_ns == 0 && !config_.manual) return check_pose(now);
  if (seen_.state.phase == LinkPhase::disconnected) return Error{"link does not reach it"};
  if (is_in_flight(seen_.state.phase)) return done;
  if (!may_take_off(seen_.state, config_.manual))
    return Error{fmt::format("it may not take off ({})", words_for(seen_.state.cause))};
  return timing_.check_delay();
}

std::optional<std::string> Phases::check_time(TimeNs now) {
  const TimeNs in_phase_ns = now - entered_ns_;
  const TimeNs silent_ns = now - seen_.received_ns;
  if (in_air() && silent_ns > config_.limits.silence_ns) {
    land(now, silence_words(now, config_.limits.silence_ns));
    return std::nullopt;
  }
  if (!in_air() || silent_ns <= config_.limits.warn_silence_ns) {
    is_silence_reported_ = false;
  } else if (!std::exchange(is_silence_reported_, true)) {
    return silence_words(now, config_.limits.warn_silence_ns);
  }
  if (const Follower* follower = planner_.follower(); in_air() && follower) {
    const Status checked = follower->check();
    if (!checked && !config_.manual) {
      land(now, checked.error().message);
      return std::nullopt;
    }
    if (!checked && status_.phase == GroundPhase::path) return abandon_path(now, checked.error().message);
  }
  switch (status_.phase) {
    case GroundPhase::waiting: {
      if (config_.manual || in_phase_ns <= config_.limits.wait_ns) return std::nullopt;
      const Status ready = check_ready(now);
      status_.why =
          fmt::format("{} within {:.0f} s", ready ? "it never was ready on the ground" : ready.error().message,
                      to_seconds(config_.limits.wait_ns));
      enter(now, GroundPhase::failed);
      return std::nullopt;
    }
    case GroundPhase::takeoff:
      if (in_phase_ns > config_.limits.takeoff_ns)
        land(now, fmt::format("did not take off within {:.0f} s", to_seconds(config_.limits.takeoff_ns)));
      return std::nullopt;
    case GroundPhase::path:
      if (in_phase_ns > path_limit_ns()) {
        const std::string late = fmt::format("did not finish its path within {:.0f} s", to_seconds(path_limit_ns()));
        if (config_.manual) return abandon_path(now, late);
        land(now, late);
      }
      return std::nullopt;
    case GroundPhase::landing:
      if (in_phase_ns > config_.limits.landing_ns) {
        const std::string silent =
            fmt::format("was not seen to land within {:.0f} s", to_seconds(config_.limits.landing_ns));
        status_.why += (status_.why.empty() ? "" : "; ") + silent;
        enter(now, GroundPhase::failed);
      }
      return std::nullopt;
    case GroundPhase::manual:
    case GroundPhase::landed:
    case GroundPhase::failed:
      return std::nullopt;
  }
  return std::nullopt;
}

// Without any drone's states there may be no blocks, either: they come while somebody writes. Those of our own last
// commands still come shortly after the last state, so that only the limit's second half counts.
std::string Phases::silence_words(TimeNs now, TimeNs limit_ns) const {
  const char* const who = !config_.ledger ? ""
                          : now - seen_.block_ns <= limit_ns / 2
                              ? ", though blocks come: look at its host's agent and link"
                              : ", nor any block: the ledger is silent, or all who write to it";
  return fmt::format("no state came for {:.1f} s{}", to_seconds(limit_ns), who);
}

std::string Phases::abandon_path(TimeNs now, const std::string& why) {
  enter(now, GroundPhase::manual);
  return fmt::format("{}: it hovers", why);
}

Status Phases::apply_order(TimeNs now, const PilotOrder& order, TimeNs delay_ns) {
  Status taken = check_flying(now);
  // What makes link brake outlasts a plan; a pose that is lost is said below, in its own words.
  if (taken && seen_.state.mode == FailsafeMode::brake && check_pose(now))
    taken = Error{fmt::format("its failsafe brakes it ({})", words_for(seen_.state.cause))};
  switch (order.kind) {
    case PilotOrder::Kind::path:
      if (taken) taken = fly_checked(now, order.waypoints, order.land_behind, delay_ns);
      return named("no path: ", taken);
    case PilotOrder::Kind::resume:
      if (taken && !status_.paused)
        taken = Error{status_.phase == GroundPhase::path ? "it flies its path" : "no path of it is paused"};
      if (taken)
        taken = fly_checked(now, planner_.pilot_path()->rest(), planner_.pilot_path()->land_behind(), delay_ns);
      return named("no resume: ", taken);
    case PilotOrder::Kind::return_home:
      if (taken && !origin_known_)
        taken = Error{"where it took off is not known (it was found in the air, or had no pose then)"};
      if (taken) {
        const double height_m = std::clamp(seen_.state.position_m[2], motion::min_height_m, motion::max_height_m);
        // However far it has got: this place is nobody's mistake in writing.
        taken = fly(now, {{{status_.origin_m[0], status_.origin_m[1]}, height_m}}, false, delay_ns);
      }
      return named("no return: ", taken);
  }
  return done;
}

Status Phases::pause_path(TimeNs now) {
  Status flying = check_flying(now);
  if (flying && status_.phase != GroundPhase::path)
    flying = Error{status_.paused ? "it is paused already" : "it flies no path"};
  if (!flying) return named("no pause: ", flying);
  auto planned = std::move(status_.planned);
  enter(now, GroundPhase::manual);
  status_.planned = std::move(planned);
  status_.paused = true;
  return done;
}

Status Phases::check_flying(TimeNs now) const {
  if (!config_.manual) return Error{"it flies the path of its flight"};
  switch (status_.phase) {
    case GroundPhase::path:
    case GroundPhase::manual:
      return done;
    case GroundPhase::takeoff:
      return Error{"it is still taking off"};
    case GroundPhase::landing:
      return Error{"it is landing"};
    case GroundPhase::waiting:
    case GroundPhase::landed:
    case GroundPhase::failed:
      break;
  }
  const Status ready = check_ready(now);
  return ready ? Status(Error{"it is not in the air: let it take off first"}) : ready;
}

Status Phases::check_pose(TimeNs now) const {
  const StateSample& s = seen_.state;
  if (s.pose_stamp_ns == 0) return Error{"it has no pose (no motion capture, and [pose] source asks for it?)"};
  if (s.stamp_ns - s.pose_stamp_ns + (now - seen_.received_ns) > config_.controller.pose_lost_ns)
    return Error{"its pose is lost: nobody knows where it is"};
  return done;
}

Status Phases::fly_checked(TimeNs now, const std::vector<Waypoint>& way, bool land_behind, TimeNs delay_ns) {
  if (Status pose = check_pose(now); !pose) return pose;
  const Eigen::Vector2d here(seen_.state.position_m[0], seen_.state.position_m[1]);
  if (Status checked = motion::check_way(way, here); !checked) return checked;
  return fly(now, way, land_behind, delay_ns);
}

Status Phases::fly(TimeNs now, const std::vector<Waypoint>& way, bool land_behind, TimeNs delay_ns) {
  if (Status pose = check_pose(now); !pose) return pose;
  const TimeNs from_ns = seen_.state.stamp_ns + (now - seen_.received_ns) + delay_ns;
  if (Status begun = planner_.begin_pilot_path(way, land_behind, from_ns); !begun) return begun;
  status_.progress = 0;
  status_.reached = 0;
  ++status_.paths;
  enter(now, GroundPhase::path);
  return done;
}

}  // namespace ledgerline::ground
