#include "ground/core/flight/phases.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/access/identity.hpp"
#include "common/msg/grants.hpp"
#include "common/msg/names.hpp"
#include "common/msg/stops.hpp"
#include "ground/core/flight/near.hpp"

namespace ledgerline::ground {
namespace {

constexpr TimeNs grounded_for_ns = 2 * ns_per_s;  // a take-off command may still be in flight
constexpr TimeNs refused_for_ns = 2 * ns_per_s;   // link takes no older plan, so what came by then was this take-off
constexpr TimeNs end_wait_ns = 3 * ns_per_s;      // for the drone to come up to the path's end

std::string revoked_words(const Lease& lease) {
  return is_revoked(*lease.record, lease.record->holder())
             ? fmt::format("its operator {} is revoked", lease.holder->subject)
             : fmt::format("{}, who commands it, is revoked", lease.commander->subject);
}

}  // namespace

bool may_take_off(const StateSample& state, bool manual) {
  switch (state.cause) {
    case FailsafeCause::none:
    case FailsafeCause::stopped:
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

void Phases::enter(TimeNs now, DronePhase phase) {
  status_.phase = phase;
  entered_ns_ = now;
  status_.paused = false;
  if (phase != DronePhase::takeoff && phase != DronePhase::path) status_.planned.clear();
}

void Phases::land(TimeNs now, const std::string& why) {
  if (status_.phase >= DronePhase::landing) return;
  end_path();
  if (status_.why.empty()) status_.why = why;
  enter(now, status_.phase == DronePhase::waiting ? DronePhase::failed : DronePhase::landing);
}

std::string Phases::land_by_pilot(TimeNs now, const std::string& why) {
  // A flight along a path that waits would take off as soon as nothing speaks against it.
  const bool waits_to_fly = status_.phase == DronePhase::waiting && !config_.manual;
  if (in_air() || waits_to_fly) land(now, why);
  if (status_.phase == DronePhase::failed && seen_.has_state && in_flight(seen_.state.phase))
    enter(now, DronePhase::landing);
  if (status_.phase != DronePhase::waiting) return "";
  const std::string missing = not_ready(now);
  return missing.empty() ? "it is on the ground" : missing;
}

void Phases::end_path() {
  if (status_.phase == DronePhase::path || status_.phase == DronePhase::manual)
    status_.path_ns[1] = seen_.state.stamp_ns;
}

void Phases::lease_changed(TimeNs now) {
  if (config_.manual && status_.phase == DronePhase::waiting && lease_.may_command) status_.why.clear();
  if (!in_air()) return;
  if (is_stopped(lease_.stoppers)) {
    land(now, "stopped by " + stopper_names(lease_.stoppers));
  } else if (lease_.commander != config_.self || lease_.revoked) {
    end_path();
    status_.why = lease_.commander != config_.self
                      ? "lost its lease" + (lease_.holder ? " to " + holder_words(lease_) : "")
                      : revoked_words(lease_);
    const bool ourselves = lease_.revoked && is_revoked(*lease_.record, to_message(config_.self));
    // Handed back, or held by another one who lets us command, its pilot flies it on.
    enter(now, config_.manual && !ourselves ? DronePhase::waiting : DronePhase::failed);
  }
}

std::string Phases::take_off(TimeNs now, bool ending) {
  std::string why = not_ready(now);
  if (status_.phase == DronePhase::landing) why = "it is landing";
  if (ending) why = "the flight is ending";
  if (in_air()) why = "it is in the air";
  if (!config_.manual) why = "it flies a path";
  if (!why.empty()) return why;
  flew_ = false;
  planner_.manual().release();
  status_.why.clear();
  status_.origin_m = {seen_.state.position_m[0], seen_.state.position_m[1]};
  origin_known_ = no_pose(now).empty();
  asked_ns_ = seen_.state.stamp_ns;
  enter(now, DronePhase::takeoff);
  return "";
}

// Whether a pilot may do without a pose only link's config knows: it is asked, and what it makes of that is seen.
std::string Phases::refused_takeoff(TimeNs now) {
  const StateSample& s = seen_.state;
  const bool stands = s.phase == FlightPhase::on_ground || s.phase == FlightPhase::landed;
  if (status_.phase != DronePhase::takeoff || !config_.manual || flew_ || !stands || may_take_off(s, false) ||
      s.arrived_ns - asked_ns_ < refused_for_ns)
    return "";
  enter(now, DronePhase::waiting);
  const bool of_pose = s.cause == FailsafeCause::pose_lost || s.cause == FailsafeCause::position_uncertain;
  return fmt::format("link refuses it ({}{})", words_for(s.cause),
                     of_pose ? "; where its by_hand_without_pose is set a pilot does without" : "");
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
  const bool grounded = s.phase == FlightPhase::on_ground || s.phase == FlightPhase::landed;
  switch (status_.phase) {
    case DronePhase::waiting:
      return advance_waiting(now);
    case DronePhase::takeoff:
      return advance_takeoff(now, delay_ns);
    case DronePhase::path:
    case DronePhase::manual:
      return advance_flown(now);
    case DronePhase::landing:
      if (grounded && (flew_ || now - entered_ns_ > grounded_for_ns)) enter(now, DronePhase::landed);
      return;
    case DronePhase::landed:
    case DronePhase::failed:
      return;
  }
}

void Phases::advance_waiting(TimeNs now) {
  const StateSample& s = seen_.state;
  const bool grounded = s.phase == FlightPhase::on_ground || s.phase == FlightPhase::landed;
  const bool flying = s.phase == FlightPhase::flying;
  if (config_.manual) {
    // Found in the air, it is held there: see takeoff.
    if (!flying || !not_ready(now).empty()) return;
    origin_known_ = false;
    enter(now, DronePhase::takeoff);
    return;
  }
  if (!lease_.may_command || s.pose_stamp_ns == 0 || !(grounded || flying)) return;
  if (grounded && (!may_take_off(s, config_.manual) || !timing_.too_slow().empty())) return;
  status_.origin_m = {s.position_m[0], s.position_m[1]};
  if (const Status begun = planner_.begin_path(status_.origin_m, s.yaw_rad); !begun) {
    status_.why = begun.error().what;
    enter(now, DronePhase::failed);
    return;
  }
  enter(now, DronePhase::takeoff);
}

void Phases::advance_takeoff(TimeNs now, TimeNs delay_ns) {
  const StateSample& s = seen_.state;
  if (s.phase != FlightPhase::flying) {
    if (flew_) land(now, fmt::format("came down by itself: {}", words_for(s.cause)));
    return;
  }
  if (!flew_) settling_since_ns_ = s.stamp_ns;
  flew_ = true;
  if (config_.manual) {
    status_.path_ns = {s.stamp_ns, 0};
    enter(now, DronePhase::manual);
  } else if (settled()) {
    path_since_ns_ = status_.path_ns[0] = s.stamp_ns + delay_ns;
    planner_.start_path(path_since_ns_);
    enter(now, DronePhase::path);
  } else if (s.stamp_ns - settling_since_ns_ > config_.settle_ns) {
    land(now, fmt::format("did not settle above where it took off within {:.0f} s", to_seconds(config_.settle_ns)));
  }
}

void Phases::advance_flown(TimeNs now) {
  const StateSample& s = seen_.state;
  if (s.phase != FlightPhase::flying) {
    land(now, fmt::format("came down by itself: {}", words_for(s.cause)));
  } else if (s.mode == FailsafeMode::land || s.mode == FailsafeMode::cut) {
    land(now, fmt::format("its failsafe landed it: {}", words_for(s.cause)));
  } else if (status_.phase == DronePhase::path) {
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
  enter(now, DronePhase::landing);
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
    enter(now, DronePhase::manual);
  }
}

TimeNs Phases::path_limit_ns() const {
  constexpr double spare_s = 30;
  if (config_.manual) return from_seconds(config_.path_factor * planner_.follower()->expected_s(1) + spare_s);
  if (config_.seconds > 0) return from_seconds(config_.seconds + spare_s);
  return from_seconds(config_.path_factor * planner_.follower()->expected_s(planner_.laps()) + spare_s);
}

// What speaks against a take-off; empty: nothing.
std::string Phases::not_ready(TimeNs now) const {
  if (!seen_.has_state) return "no state came through the ledger";
  if (is_stopped(lease_.stoppers)) return "it is stopped by " + stopper_names(lease_.stoppers);
  if (!lease_.may_command)
    return lease_.holder ? "its lease is held by " + holder_words(lease_) : "nobody holds its lease";
  if (seen_.state.pose_stamp_ns == 0 && !config_.manual) return no_pose(now);
  if (seen_.state.phase == FlightPhase::disconnected) return "link does not reach it";
  if (!in_flight(seen_.state.phase) && !may_take_off(seen_.state, config_.manual))
    return fmt::format("it may not take off ({})", words_for(seen_.state.cause));
  return in_flight(seen_.state.phase) ? "" : timing_.too_slow();
}

std::string Phases::check_time(TimeNs now) {
  const TimeNs in_phase_ns = now - entered_ns_;
  if (in_air() && now - seen_.received_ns > config_.silence_ns) {
    land(now, fmt::format("no state came for {:.1f} s", to_seconds(config_.silence_ns)));
    return "";
  }
  if (const Follower* follower = planner_.follower(); in_air() && follower) {
    const std::string problem = follower->problem();
    if (!problem.empty() && !config_.manual) {
      land(now, problem);
      return "";
    }
    if (!problem.empty() && status_.phase == DronePhase::path) return give_up_path(now, problem);
  }
  switch (status_.phase) {
    case DronePhase::waiting: {
      if (config_.manual || in_phase_ns <= config_.wait_ns) return "";
      const std::string missing = not_ready(now);
      status_.why = fmt::format("{} within {:.0f} s", missing.empty() ? "it never was ready on the ground" : missing,
                                to_seconds(config_.wait_ns));
      enter(now, DronePhase::failed);
      return "";
    }
    case DronePhase::takeoff:
      if (in_phase_ns > config_.takeoff_ns)
        land(now, fmt::format("did not take off within {:.0f} s", to_seconds(config_.takeoff_ns)));
      return "";
    case DronePhase::path:
      if (in_phase_ns > path_limit_ns()) {
        const std::string late = fmt::format("did not finish its path within {:.0f} s", to_seconds(path_limit_ns()));
        if (config_.manual) return give_up_path(now, late);
        land(now, late);
      }
      return "";
    case DronePhase::landing:
      if (in_phase_ns > config_.landing_ns) {
        const std::string silent = fmt::format("was not seen to land within {:.0f} s", to_seconds(config_.landing_ns));
        status_.why += (status_.why.empty() ? "" : "; ") + silent;
        enter(now, DronePhase::failed);
      }
      return "";
    case DronePhase::manual:
    case DronePhase::landed:
    case DronePhase::failed:
      return "";
  }
  return "";
}

std::string Phases::give_up_path(TimeNs now, const std::string& why) {
  enter(now, DronePhase::manual);
  return fmt::format("{}: it hovers", why);
}

}  // namespace ledgerline::ground
