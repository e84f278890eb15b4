#include "tools/launcher/preflight/check.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/msg/names.hpp"
#include "common/msg/pose_messages.hpp"

namespace ledgerline::fly {
namespace {

// Enough for a flight of minutes and the way home; a Tello loses 1 % in eight seconds. A warning alone: link has the
// limit that counts.
constexpr double good_battery = 0.5;
// On the ground nothing cools it, and users report Tellos that switched themselves off there (docs/sources.md).
constexpr double warm_c = 85;
// A Tello sends ten a second. Below half of that every second one is lost, and so are setpoints on the same Wi-Fi.
constexpr double good_state_hz = 8, least_state_hz = 4;
// Two poses within the time after which one counts as lost: with fewer a single lost one stops the flight.
constexpr double poses_in_time = 2;
constexpr double good_pose_hz = 30;
// The stamps that agent accepts (mocap_clock.hpp).
constexpr double max_ahead_ms = 20, max_behind_ms = 1000;

constexpr const char* clock_cure =
    "set the clocks of both computers by NTP (chrony: `chronyc tracking` shows the offset), or [pose] clock = "
    "\"arrival\"";

constexpr const char* wifi_cure = "go nearer, or to a Wi-Fi channel that nobody else has";
constexpr const char* senses_cure =
    "light, and a floor with something to be seen on it; a firmware whose state text has vgx, vgy, vgz";

class Lines {
 public:
  explicit Lines(std::string drone) : drone_(std::move(drone)) {}
  void ok(const char* check, std::string what) { add(check, Verdict::ok, std::move(what), ""); }
  void warn(const char* check, std::string what, std::string cure) {
    add(check, Verdict::warn, std::move(what), std::move(cure));
  }
  void bad(const char* check, std::string what, std::string cure) {
    add(check, Verdict::bad, std::move(what), std::move(cure));
  }
  std::vector<Line> take() { return std::move(lines_); }

 private:
  void add(const char* check, Verdict verdict, std::string what, std::string cure) {
    lines_.push_back({drone_, check, verdict, std::move(what), std::move(cure)});
  }
  std::string drone_;
  std::vector<Line> lines_;
};

std::string where(const DroneFacts& drone) {
  return drone.interface.empty() ? drone.address : drone.address + " behind " + drone.interface;
}

void assess_presence(const DroneFacts& drone, Lines& lines) {
  if (!drone.there) {
    lines.bad("drone", fmt::format("{} does not answer", where(drone)),
              fmt::format("switch it on, and join its Wi-Fi: `ledgerline tello find --address {}{}`", drone.address,
                          drone.interface.empty() ? "" : " --interface " + drone.interface));
  } else if (!drone.wanted_serial.empty() && !drone.serial.empty() && drone.serial != drone.wanted_serial) {
    lines.bad("drone", fmt::format("{} says serial {}, not {}", where(drone), drone.serial, drone.wanted_serial),
              "look where each is with `ledgerline tello find`, and give it its address in the file");
  } else {
    lines.ok("drone", where(drone));
  }
}

void assess_temperature(const DroneFacts& drone, Lines& lines) {
  if (!drone.temperature_c) return;  // not every firmware says it
  const std::string degrees = fmt::format("{:.0f} degrees", *drone.temperature_c);
  if (*drone.temperature_c > warm_c) {
    lines.warn("temperature", degrees + ": on the ground nothing cools it, and it may switch itself off",
               "take off soon, or switch it off and let it cool");
  } else {
    lines.ok("temperature", degrees);
  }
}

void assess_battery(const Facts& facts, const DroneFacts& drone, Lines& lines) {
  if (!drone.battery)
    return lines.warn("battery", "it does not say", "ask it: `ledgerline tello info " + drone.address + "`");
  const std::string share = fmt::format("{:.0f} %", 100 * *drone.battery);
  const double least = static_cast<double>(facts.link.failsafe.battery_low);
  if (drone.refusal == "battery_low" || *drone.battery <= least) {
    lines.bad("battery", fmt::format("{}: link takes off above {:.0f} %", share, 100 * least), "charge or change it");
  } else if (*drone.battery < good_battery) {
    lines.warn("battery", fmt::format("{}: enough to take off, not for long", share), "charge or change it");
  } else {
    lines.ok("battery", share);
  }
}

void assess_state(const DroneFacts& drone, Lines& lines) {
  if (!drone.state_hz) return;
  const std::string rate = fmt::format("{:.1f} state texts a second", *drone.state_hz);
  if (*drone.state_hz == 0) {
    lines.bad("state", "no state text comes to UDP port 8890",
              "let UDP 8890 through this computer's firewall; end every other program that speaks to the drone");
  } else if (*drone.state_hz < least_state_hz) {
    lines.bad("state", rate + ", of ten", wifi_cure);
  } else if (*drone.state_hz < good_state_hz) {
    lines.warn("state", rate + ", of ten", wifi_cure);
  } else {
    lines.ok("state", rate);
  }
}

void assess_mocap(const Facts& facts, const DroneFacts& drone, Lines& lines) {
  const std::string from = facts.pose_topic.empty() ? facts.pose_source : pose_topic_of(facts.pose_topic, drone.name);
  const double limit_ms = to_ms(facts.link.failsafe.pose_lost_ns);
  if (!drone.pose) {
    return lines.bad("pose", "no pose of it has come from " + from,
                     "start motion capture and its ROS 2 driver, with this rigid body's name (`ros2 topic hz` shows "
                     "it); from another computer: a file for DDS (docs/dds.md)");
  }
  const PoseFacts& pose = *drone.pose;
  std::string what = fmt::format("{}, {:.0f} ms old: {:.2f}, {:.2f}, {:.2f} m", from, pose.age_ms, pose.position_m[0],
                                 pose.position_m[1], pose.position_m[2]);
  if (!pose.frame.empty()) what += fmt::format(" in \"{}\"", pose.frame);
  if (pose.rate_hz) what += fmt::format(", {:.0f} a second", *pose.rate_hz);
  if (pose.age_ms > limit_ms || drone.refusal == "pose_lost") {
    lines.bad("pose", fmt::format("{}; link takes none older than {:.0f} ms", what, limit_ms),
              "look whether motion capture sees the drone: markers, cameras, its own clock");
  } else if (pose.rate_hz && *pose.rate_hz * limit_ms < poses_in_time * 1000) {
    lines.bad("pose", fmt::format("{}: one that is lost would stop the flight", what),
              "let motion capture publish more often, 100 a second");
  } else if (pose.rate_hz && *pose.rate_hz < good_pose_hz) {
    lines.warn("pose", what + ": slow", "let motion capture publish more often, 100 a second");
  } else {
    lines.ok("pose", what);
  }
}

void assess_odometry(const Facts& facts, const DroneFacts& drone, Lines& lines) {
  const std::string by = fmt::format("by onboard odometry ({})", facts.pose_source);
  if (!drone.has_velocity || drone.refusal == "velocity_lost" || drone.refusal == "height_lost") {
    lines.bad("pose", by + ", and it reports no velocity that link accepts", senses_cure);
  } else if (drone.refusal == "position_uncertain") {
    lines.bad("pose", by + ": too uncertain for the fence", "put it on its mark and switch it off and on");
  } else {
    lines.ok("pose", drone.pose ? fmt::format("{}: {:.2f}, {:.2f}, {:.2f} m", by, drone.pose->position_m[0],
                                              drone.pose->position_m[1], drone.pose->position_m[2])
                                : by);
  }
}

void assess_pose(const Facts& facts, const DroneFacts& drone, Lines& lines) {
  if (facts.pose_source == "none") return lines.ok("pose", "none: it is flown by hand");
  const auto source = from_name<link::PoseSource>(facts.pose_source);
  if (!source || !link::uses_mocap(*source)) return assess_odometry(facts, drone, lines);
  // By onboard odometry it may have landed, and no pose has come since.
  if (drone.refusal == "velocity_lost" || drone.refusal == "height_lost" || drone.refusal == "position_uncertain") {
    lines.bad("pose", "its newest position is of onboard odometry, not of motion capture",
              "look whether motion capture sees the drone");
  } else {
    assess_mocap(facts, drone, lines);
  }
  if (link::uses_odometry(*source) && !drone.has_velocity) {
    lines.warn("senses", "it reports no velocity: nothing stands in for motion capture", senses_cure);
  }
}

// What other lines do not report of a refusal of link's.
void assess_refusal(const DroneFacts& drone, Lines& lines) {
  if (!drone.phase.empty()) {
    return lines.bad("link", "it is not on the ground: " + drone.phase,
                     fmt::format("land it: `ledgerline tello land {}`", drone.address));
  }
  struct Cure {
    const char *cause, *cure;
  };
  constexpr Cure cures[] = {
      {"stopped",
       "who stopped it clears it: `ledgerline control clear_stop NAME`; what link stopped by itself as well"},
      {"state_stale", wifi_cure},
      {"agent_silent", "look why agent does not run: its log"},
      {"ledger_silent", "look whether the ledger's peer is reached: agent's log"},
      {"ledger_untrusted", "agent's log says what of the ledger contradicts itself (docs/failsafe.md)"},
      {"tilted", "put it on level ground"},
      {"too_near", "put the drones further apart"},
      {"other_client",
       "end the other program that commands it: link of another host with its address, or `ledgerline tello`"},
      {"fence", "put it inside the fence, or let [fence] be the room's"}};
  const std::string reported_elsewhere[] = {
      "", "none", "battery_low", "pose_lost", "velocity_lost", "height_lost", "position_uncertain"};
  if (std::find(std::begin(reported_elsewhere), std::end(reported_elsewhere), drone.refusal) !=
      std::end(reported_elsewhere))
    return;
  const auto* known =
      std::find_if(std::begin(cures), std::end(cures), [&](const Cure& one) { return drone.refusal == one.cause; });
  lines.bad("link", "it refuses a take-off: " + drone.refusal,
            known != std::end(cures) ? known->cure : "docs/failsafe.md says what this cause clears by");
}

void assess_lease(const Facts& facts, const DroneFacts& drone, Lines& lines) {
  const LeaseFacts& lease = drone.lease;
  if (!lease.enrolled) {
    if (facts.enrols) return lines.ok("lease", "not enrolled yet: it is before the flight");
    return lines.bad(
        "lease", "nobody has enrolled it on this ledger",
        fmt::format("`ledgerline control enroll {}` as an administrator, or name [ledger] admin", drone.name));
  }
  if (!lease.stoppers.empty()) {
    return lines.bad("lease", fmt::format("it is stopped by {}", fmt::join(lease.stoppers, ", ")),
                     fmt::format("they clear it: `ledgerline control clear_stop {}`", drone.name));
  }
  switch (lease.holder) {
    case LeaseFacts::Holder::unknown:
      return;
    case LeaseFacts::Holder::free:
      return lines.ok("lease", "free: it is acquired before the flight");
    case LeaseFacts::Holder::ours:
      return lines.ok("lease", "ours");
    case LeaseFacts::Holder::for_us:
      return lines.ok("lease", "ours to command: held by " + lease.holder_name);
    case LeaseFacts::Holder::other:
      return lines.bad("lease", "held by " + lease.holder_name,
                       fmt::format("ask for it: `ledgerline control request {0}`; or pre-empt it: `ledgerline control "
                                   "acquire --priority N {0}`",
                                   drone.name));
  }
}

bool outside(const link::FenceSettings& fence, const std::array<double, 3>& at_m) {
  // On the ground height says nothing: a marker, or a floor that is not quite z = 0, as link's own check has it.
  // And what is no number is nowhere.
  return !(at_m[0] >= fence.min_m[0] && at_m[0] <= fence.max_m[0] && at_m[1] >= fence.min_m[1] &&
           at_m[1] <= fence.max_m[1]);
}

Line assess_fence(const Facts& facts) {
  const link::FenceSettings& f = facts.link.fence;
  const std::string box = fmt::format("x {:g} to {:g}, y {:g} to {:g}, z {:g} to {:g} m", f.min_m[0], f.max_m[0],
                                      f.min_m[1], f.max_m[1], f.min_m[2], f.max_m[2]);
  for (const DroneFacts& drone : facts.drones) {
    if (!drone.there || !drone.pose || !outside(f, drone.pose->position_m)) continue;
    return {"", "fence", Verdict::bad,
            fmt::format("{}: {} stands outside, at {:.2f}, {:.2f} m", box, drone.name, drone.pose->position_m[0],
                        drone.pose->position_m[1]),
            "put it inside, or let [fence] and motion capture have the same origin and axes"};
  }
  if (!facts.path_beyond.empty())
    return {"", "fence", Verdict::bad, facts.path_beyond, "a smaller side, another start, or [fence] as the room is"};
  const char* without_pose = facts.pose_source == "none" ? ": of these the ceiling alone holds" : "";
  return {"", "fence", Verdict::ok, box + without_pose, ""};
}

// Of several drones: only in one frame do a fence and distances mean anything.
std::optional<Line> assess_frames(const Facts& facts) {
  const DroneFacts* first = nullptr;
  for (const DroneFacts& drone : facts.drones) {
    if (!drone.pose || drone.pose->frame.empty()) continue;
    if (first && drone.pose->frame != first->pose->frame) {
      return Line{
          "", "frame", Verdict::bad,
          fmt::format("{} is in \"{}\", {} in \"{}\"", first->name, first->pose->frame, drone.name, drone.pose->frame),
          "let one motion capture publish all of them in one frame"};
    }
    if (!first) first = &drone;
  }
  if (!first) return std::nullopt;
  return Line{"", "frame", Verdict::ok, fmt::format("\"{}\", taken as map: x east, y north, z up", first->pose->frame),
              ""};
}

Line assess_clocks(const Facts& facts) {
  for (const DroneFacts& drone : facts.drones) {
    if (!facts.stamps_count || !drone.pose || !drone.pose->delay_ms) continue;
    const double delay_ms = *drone.pose->delay_ms;
    if (delay_ms >= -max_ahead_ms && delay_ms <= max_behind_ms) continue;
    return {"", "clocks", Verdict::bad,
            fmt::format("stamps of {}'s poses are {:.0f} ms {} this computer's clock: agent drops them", drone.name,
                        std::abs(delay_ms), delay_ms < 0 ? "ahead of" : "behind"),
            clock_cure};
  }
  const ClockFacts& clock = facts.clock;
  if (!clock.known)
    return {"", "clocks", Verdict::warn, "the kernel does not say whether this computer's is synchronised", clock_cure};
  if (!clock.synchronised) {
    return {"", "clocks", Verdict::warn, "the kernel says that this computer's is not synchronised",
            "chrony, or another client of NTP, here and on every other computer of the flight"};
  }
  return {"", "clocks", Verdict::ok,
          fmt::format("this computer's is synchronised, within {:.1f} ms", clock.max_error_ms), ""};
}

Line assess_ledger(const LedgerFacts& ledger) {
  switch (ledger.state) {
    case LedgerFacts::State::starts:
      return {"", "ledger", Verdict::ok, ledger.what + ": the flight starts it", ""};
    case LedgerFacts::State::reached:
      return {"", "ledger", Verdict::ok, ledger.what + ": reached", ""};
    case LedgerFacts::State::failed:
      break;
  }
  return {"", "ledger", Verdict::bad, ledger.what,
          "is its peer up, and endpoint, tls_ca and msp_dir of [ledger] in the file of ledger.ground right?"};
}

constexpr const char* name(Verdict verdict) {
  return verdict == Verdict::ok ? "ok" : verdict == Verdict::warn ? "warn" : "bad";
}

nlohmann::json or_null(const std::string& text) { return text.empty() ? nlohmann::json() : nlohmann::json(text); }

}  // namespace

std::vector<Line> assess(const Facts& facts) {
  std::vector<Line> all;
  for (const DroneFacts& drone : facts.drones) {
    Lines lines(drone.name);
    assess_presence(drone, lines);
    if (drone.there) {
      assess_battery(facts, drone, lines);
      assess_temperature(drone, lines);
      assess_state(drone, lines);
      assess_pose(facts, drone, lines);
      assess_refusal(drone, lines);
    }
    assess_lease(facts, drone, lines);
    for (Line& line : lines.take()) all.push_back(std::move(line));
  }
  if (auto frames = assess_frames(facts)) all.push_back(std::move(*frames));
  all.push_back(assess_fence(facts));
  all.push_back(assess_clocks(facts));
  all.push_back(assess_ledger(facts.ledger));
  return all;
}

bool anything_bad(const std::vector<Line>& lines) {
  return std::any_of(lines.begin(), lines.end(), [](const Line& line) { return line.verdict == Verdict::bad; });
}

std::string words(const std::vector<Line>& lines) {
  std::string text = "Before take-off:";
  for (const Line& line : lines) {
    const char* mark = line.verdict == Verdict::bad ? "BAD" : name(line.verdict);
    text += fmt::format("\n  {:<5} {:<10} {:<8} {}", mark, line.drone, line.check, line.what);
    if (!line.cure.empty()) text += fmt::format("\n        cure: {}", line.cure);
  }
  return text;
}

std::string to_json(const std::vector<Line>& lines) {
  nlohmann::json checks = nlohmann::json::array();
  for (const Line& line : lines) {
    checks.push_back({{"drone", or_null(line.drone)},
                      {"check", line.check},
                      {"verdict", name(line.verdict)},
                      {"what", line.what},
                      {"cure", or_null(line.cure)}});
  }
  return nlohmann::json{{"ok", !anything_bad(lines)}, {"checks", checks}}.dump();
}

}  // namespace ledgerline::fly
