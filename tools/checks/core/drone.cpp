#include "tools/checks/core/drone.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/msg/names.hpp"
#include "common/msg/ros.hpp"
#include "onboard/link/core/drone_watches.hpp"

namespace ledgerline::checks {
namespace {

// Enough for a flight of minutes and the way home; a Tello loses 1 % in eight seconds. A warning alone: link has the
// limit that counts.
constexpr double good_battery = 0.5;
// A Tello sends ten a second. Below half of that every second one is lost, and so are setpoints on the same Wi-Fi.
constexpr double good_state_hz = 8, least_state_hz = 4;
// Two poses within the time after which one counts as lost: with fewer a single lost one stops the flight.
constexpr double poses_in_time = 2;
constexpr double good_pose_hz = 30;
// The stamps that agent accepts (mocap_clock.hpp).
constexpr double max_ahead_ms = 20, max_behind_ms = 1000;

std::optional<Finding> assess_temperature(const DroneInputs& drone) {
  if (!drone.temperature_c) return std::nullopt;  // not every firmware says it
  const std::string degrees = fmt::format("{:.0f} degrees", *drone.temperature_c);
  return *drone.temperature_c > link::HeatWatch::warm_c ? flag(Problem::drone_hot, "temperature", degrees)
                                                        : fine("temperature", degrees);
}

/// Nothing: link has nothing against a take-off, or what another version of it has.
std::optional<FailsafeCause> cause_of(const DroneInputs& drone) { return from_name<FailsafeCause>(drone.refusal); }

bool lacks_velocity(std::optional<FailsafeCause> cause) {
  return cause == FailsafeCause::velocity_lost || cause == FailsafeCause::height_lost;
}

Finding assess_mocap(const PreflightInputs& inputs, const DroneInputs& drone) {
  constexpr const char* check = "pose";
  const std::string from =
      inputs.pose_topic.empty() ? inputs.pose_source : pose_topic_of(inputs.pose_topic, drone.name);
  const double limit_ms = to_ms(inputs.link.failsafe.pose_lost_ns);
  if (!drone.pose) return flag(Problem::pose_silent, check, "agent has accepted no pose from " + from);
  const PoseInputs& pose = *drone.pose;
  std::string what = fmt::format("{}, {:.0f} ms old: {:.2f}, {:.2f}, {:.2f} m", from, pose.age_ms, pose.position_m[0],
                                 pose.position_m[1], pose.position_m[2]);
  if (!pose.frame.empty()) what += fmt::format(" in \"{}\"", pose.frame);
  if (pose.rate_hz) what += fmt::format(", {:.0f} a second", *pose.rate_hz);
  if (!pose.fault.empty()) return flag(Problem::pose_refused, check, fmt::format("{}: {}", what, pose.fault));
  if (pose.age_ms > limit_ms || cause_of(drone) == FailsafeCause::pose_lost)
    return flag(Problem::pose_old, check, fmt::format("{}; link takes none older than {:.0f} ms", what, limit_ms));
  if (pose.rate_hz && *pose.rate_hz * limit_ms < poses_in_time * 1000)
    return as_broken(flag(Problem::pose_rare, check, what + ": one that is lost would stop the flight"));
  return pose.rate_hz && *pose.rate_hz < good_pose_hz ? flag(Problem::pose_rare, check, what) : fine(check, what);
}

Finding assess_odometry(const PreflightInputs& inputs, const DroneInputs& drone) {
  constexpr const char* check = "pose";
  const std::string by = fmt::format("by onboard odometry ({})", inputs.pose_source);
  const auto cause = cause_of(drone);
  if (!drone.has_velocity || lacks_velocity(cause))
    return flag(Problem::velocity_missing, check, by + ": none that link accepts");
  if (cause == FailsafeCause::position_uncertain) return flag(Problem::position_uncertain, check, by);
  if (!drone.pose) return fine(check, by);
  const auto& at_m = drone.pose->position_m;
  return fine(check, fmt::format("{}: {:.2f}, {:.2f}, {:.2f} m", by, at_m[0], at_m[1], at_m[2]));
}

Findings assess_pose(const PreflightInputs& inputs, const DroneInputs& drone) {
  if (inputs.pose_source == "none") return {fine("pose", "none: it is flown by hand")};
  const auto source = from_name<link::PoseSource>(inputs.pose_source);
  if (!source || !link::uses_mocap(*source)) return {assess_odometry(inputs, drone)};
  Findings out;
  // By onboard odometry it may have landed, and no pose has come since.
  if (const auto cause = cause_of(drone); lacks_velocity(cause) || cause == FailsafeCause::position_uncertain)
    out.push_back(flag(Problem::pose_of_odometry, "pose", drone.refusal));
  else
    out.push_back(assess_mocap(inputs, drone));
  if (link::uses_odometry(*source) && !drone.has_velocity)
    out.push_back(flag(Problem::velocity_no_reserve, "senses", "by its state text"));
  return out;
}

/// What to do against a refusal of link's; nothing: another line reports it.
std::optional<const char*> advice_on(FailsafeCause cause) {
  using enum FailsafeCause;
  switch (cause) {
    case none:
    case battery_low:
    case pose_lost:
    case velocity_lost:
    case height_lost:
    case position_uncertain:
      return std::nullopt;
    case stopped:
      return "who stopped it clears it: `ledgerline control clear_stop NAME`; what link stopped by itself as well";
    case state_stale:
      return "go nearer, or to a Wi-Fi channel that nobody else has";
    case agent_silent:
      return "look why agent does not run: its log";
    case ledger_silent:
      return "look whether the ledger's peer is reached: agent's log";
    case ledger_untrusted:
      return "agent's log says what of the ledger contradicts itself (docs/failsafe.md)";
    case tilted:
      return "put it on level ground";
    case too_near:
      return "put the drones further apart";
    case other_client:
      return "end the other program that commands it: link of another host with its address, or `ledgerline tello`";
    case takeoff_refused_by_drone:
      return "link's log has the drone's own words; wait 10 s, and try it again";
    case fence:
      return "put it inside the fence, or let [fence] be the room's";
    case plan_ran_out:
    case held_too_long:
    case battery_critical:
    case motion_differs:
    case overturned:
    case sources_differ:
    case check_failed:
      return "";
  }
  return "";
}

// What other lines do not report of a refusal of link's.
std::optional<Finding> assess_refusal(const DroneInputs& drone) {
  constexpr const char* check = "link";
  if (!drone.phase.empty())
    return flag(Problem::not_on_ground, check, drone.phase, cure_of(Problem::not_on_ground, "ADDRESS", drone.address));
  if (drone.refusal.empty()) return std::nullopt;
  const auto cause = cause_of(drone);
  const auto advice = cause ? advice_on(*cause) : std::optional<const char*>("");
  if (!advice) return std::nullopt;
  return flag(Problem::takeoff_refused, check, drone.refusal, *advice);
}

Findings assess(const PreflightInputs& inputs, const DroneInputs& drone) {
  Findings out{assess_presence(drone)};
  const auto add_one = [&](std::optional<Finding> one) {
    if (one) out.push_back(std::move(*one));
  };
  if (drone.there) {
    const auto least = static_cast<double>(inputs.link.failsafe.battery_low);
    add_one(assess_state(drone, "0.0.0.0:8890"));
    out.push_back(assess_battery(drone, least));
    add_one(assess_temperature(drone));
    add(out, assess_pose(inputs, drone));
    add_one(assess_refusal(drone));
  }
  if (drone.lease) add(out, assess(*drone.lease));
  for (Finding& one : out) one.drone = drone.name;
  return out;
}

bool is_outside(const link::FenceSettings& fence, const std::array<double, 3>& at_m) {
  // On the ground height says nothing: a marker, or a floor that is not quite z = 0, as link's own check has it.
  // And what is no number is nowhere.
  return !(at_m[0] >= fence.min_m[0] && at_m[0] <= fence.max_m[0] && at_m[1] >= fence.min_m[1] &&
           at_m[1] <= fence.max_m[1]);
}

/// Of a drone whose position becomes too uncertain before its path's end.
std::optional<Finding> assess_drift(const PreflightInputs& inputs) {
  const link::FenceSettings& f = inputs.link.fence;
  const double width_m = std::min(f.max_m[0] - f.min_m[0], f.max_m[1] - f.min_m[1]);
  for (const link::DroneSettings& drone : inputs.link.drones) {
    if (drone.source != link::PoseSource::tello) continue;
    const double lasts_s = odometry_lasts_s(inputs.link.failsafe, drone.odometry, width_m);
    if (lasts_s >= inputs.path_s) continue;
    return flag(Problem::odometry_short, "fence",
                fmt::format("{}: after about {:.0f} s {:g} m are too narrow for it, and its path takes {:.0f} s",
                            drone.name, lasts_s, width_m, inputs.path_s));
  }
  return std::nullopt;
}

Finding assess_fence(const PreflightInputs& inputs) {
  constexpr const char* check = "fence";
  const link::FenceSettings& f = inputs.link.fence;
  const std::string box = fmt::format("x {:g} to {:g}, y {:g} to {:g}, z {:g} to {:g} m", f.min_m[0], f.max_m[0],
                                      f.min_m[1], f.max_m[1], f.min_m[2], f.max_m[2]);
  for (const DroneInputs& drone : inputs.drones) {
    if (!drone.there || !drone.pose || !is_outside(f, drone.pose->position_m)) continue;
    const auto& at_m = drone.pose->position_m;
    return flag(Problem::outside_fence, check,
                fmt::format("{}: {} at {:.2f}, {:.2f} m", box, drone.name, at_m[0], at_m[1]));
  }
  if (!inputs.path) return flag(Problem::path_beyond_fence, check, inputs.path.error().message);
  if (auto drifts = assess_drift(inputs)) return std::move(*drifts);
  return fine(check, box + (inputs.pose_source == "none" ? ": of these the ceiling alone holds" : ""));
}

// Of several drones: only in one frame do a fence and distances mean anything.
std::optional<Finding> assess_frames(const PreflightInputs& inputs) {
  constexpr const char* check = "frame";
  const DroneInputs* first = nullptr;
  for (const DroneInputs& drone : inputs.drones) {
    if (!drone.pose || drone.pose->frame.empty()) continue;
    if (first && drone.pose->frame != first->pose->frame)
      return flag(
          Problem::frames_differ, check,
          fmt::format("{} is in \"{}\", {} in \"{}\"", first->name, first->pose->frame, drone.name, drone.pose->frame));
    if (!first) first = &drone;
  }
  if (!first) return std::nullopt;
  return fine(check, fmt::format("\"{}\", taken as map: x east, y north, z up", first->pose->frame));
}

Finding assess_clocks(const PreflightInputs& inputs) {
  for (const DroneInputs& drone : inputs.drones) {
    if (!inputs.stamps_count || !drone.pose || !drone.pose->delay_ms) continue;
    const double delay_ms = *drone.pose->delay_ms;
    if (delay_ms < -max_ahead_ms || delay_ms > max_behind_ms)
      return flag(
          Problem::clock_of_poses, "clock",
          fmt::format("{}'s are {:.0f} ms {}", drone.name, std::abs(delay_ms), delay_ms < 0 ? "ahead" : "behind"));
  }
  return assess(inputs.clock);
}

Finding assess(const LedgerInputs& ledger) {
  if (ledger.state == LedgerInputs::State::failed) return flag(Problem::records_unread, "ledger", ledger.what);
  const bool starts = ledger.state == LedgerInputs::State::starts;
  return fine("ledger", ledger.what + (starts ? ": the flight starts it" : ": reached"));
}

}  // namespace

// The integral of a first-order Gauss-Markov process.
double odometry_lasts_s(const link::FailsafeSettings& failsafe, const link::OdometrySettings& odometry,
                        double width_m) {
  constexpr double hour_s = 3600;
  const double sigma_m = std::max(0.0, width_m - failsafe.min_room_m) / (2 * failsafe.fence_sigmas);
  double t_s = 0;
  for (; t_s < hour_s; t_s += 1) {
    const double share = t_s / odometry.flow_s;
    const double variance_m2 = 2 * std::pow(odometry.flow_mps * odometry.flow_s, 2) * (share - 1 + std::exp(-share));
    if (variance_m2 > sigma_m * sigma_m) break;
  }
  return t_s;
}

Finding assess_presence(const DroneInputs& drone) {
  constexpr const char* check = "drone";
  const std::string where = drone.interface.empty() ? drone.address : drone.address + " behind " + drone.interface;
  if (!drone.there)
    return flag(Problem::drone_silent, check, where,
                cure_of(Problem::drone_silent, "ADDRESS",
                        drone.address + (drone.interface.empty() ? "" : " --interface " + drone.interface)));
  if (!drone.wanted_serial.empty() && !drone.serial.empty() && drone.serial != drone.wanted_serial)
    return flag(Problem::drone_other, check,
                fmt::format("{} says serial {}, not {}", where, drone.serial, drone.wanted_serial));
  return fine(check, where);
}

Finding assess_battery(const DroneInputs& drone, double battery_low) {
  constexpr const char* check = "battery";
  if (!drone.battery)
    return flag(Problem::battery_unknown, check, drone.address,
                cure_of(Problem::battery_unknown, "ADDRESS", drone.address));
  const std::string share = fmt::format("{:.0f} %", 100 * *drone.battery);
  if (cause_of(drone) == FailsafeCause::battery_low || *drone.battery <= battery_low)
    return flag(Problem::battery_low, check, fmt::format("{}; battery_low is {:.0f} %", share, 100 * battery_low));
  return *drone.battery < good_battery ? flag(Problem::battery_short, check, share) : fine(check, share);
}

std::optional<Finding> assess_state(const DroneInputs& drone, const std::string& listen) {
  constexpr const char* check = "state";
  if (!drone.state_hz) return std::nullopt;
  if (*drone.state_hz == 0 && !drone.unreadable.empty())
    return flag(Problem::state_unreadable, check, fmt::format("\"{}\" at {}", drone.unreadable, listen));
  if (*drone.state_hz == 0)
    return flag(Problem::state_silent, check, "none at " + listen,
                cure_of(Problem::state_silent, "8890", listen.substr(listen.rfind(':') + 1)));
  const std::string rate = fmt::format("{:.1f} state texts a second", *drone.state_hz);
  if (*drone.state_hz < least_state_hz) return as_broken(flag(Problem::state_rare, check, rate));
  return *drone.state_hz < good_state_hz ? flag(Problem::state_rare, check, rate) : fine(check, rate);
}

Findings assess(const PreflightInputs& inputs) {
  Findings all;
  for (const DroneInputs& drone : inputs.drones) add(all, assess(inputs, drone));
  if (auto frames = assess_frames(inputs)) all.push_back(std::move(*frames));
  all.push_back(assess_fence(inputs));
  all.push_back(assess_clocks(inputs));
  all.push_back(assess(inputs.ledger));
  add(all, inputs.blocks);
  return all;
}

}  // namespace ledgerline::checks
