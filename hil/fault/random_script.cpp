#include "hil/fault/random_script.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <numbers>

#include "hil/sitl/world_setup.hpp"

namespace ledgerline::hil {
namespace {

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}
  std::size_t below(std::size_t n) { return random_.next() % n; }
  double between(double least, double most) { return least + (most - least) * random_.uniform(); }
  template <typename T, std::size_t N>
  const T& of(const std::array<T, N>& all) {
    return all[below(N)];
  }

 private:
  Random random_;
};

std::string milliseconds(double ms) { return fmt::format("{:.0f}ms", ms); }

std::string milliseconds(Draw& draw, double least, double most) { return milliseconds(draw.between(least, most)); }

// `recording`: a file of delays, or empty.
std::string distribution(Draw& draw, const std::string& recording, double max_ms) {
  switch (draw.below(recording.empty() ? 4 : 5)) {
    case 0:
      return milliseconds(draw, 5, max_ms);
    case 1:
      return "uniform 0ms " + milliseconds(draw, 10, max_ms);
    case 2:
      return "normal " + milliseconds(draw, 10, max_ms / 2) + " " + milliseconds(draw, 1, max_ms / 4);
    case 3:
      return "gamma " + milliseconds(draw, 20, max_ms / 2) + " " + milliseconds(draw, 10, max_ms / 4);
    default:
      return "recorded " + recording;
  }
}

constexpr std::size_t all_effects = 11, effects_of_memory = 8;  // the last ones change bytes, or count them

std::string effect(Draw& draw, const std::string& recording, std::size_t kinds = all_effects) {
  switch (draw.below(kinds)) {
    case 0:
      return "delay " + distribution(draw, recording, 600);
    case 1:
      return "jitter " + distribution(draw, recording, 400);
    case 2:
      return fmt::format("loss {:.0f}%", draw.between(1, 90));
    case 3:
      return fmt::format("loss bursts {:.0f}% {:.0f}%", draw.between(1, 20), draw.between(5, 50));
    case 4:
      return fmt::format("duplicate {:.0f}% {}", draw.between(1, 60), milliseconds(draw.between(0, 300)));
    case 5:
      return fmt::format("reorder {:.0f}% {}", draw.between(1, 60), milliseconds(draw.between(1, 200)));
    case 6:
      return "stall";
    case 7:
      return "partition";
    case 8:
      return fmt::format("corrupt {:.0f}%", draw.between(1, 60));
    case 9:
      return fmt::format("truncate {:.0f}%", draw.between(1, 60));
    default:
      return fmt::format("rate {:.0f}B/s", draw.between(200, 5'000));
  }
}

std::string ledger_fault(Draw& draw, const std::string& recording) {
  constexpr std::array<const char*, 3> ends{"agent", "ground", "both"};
  constexpr std::array<const char*, 3> ways{"", "to ", "from "};
  constexpr std::array<const char*, 10> all_lies{"chain",    "hash",   "number",  "signature", "endorsement",
                                                 "outsider", "member", "channel", "contract",  "flag"};
  constexpr std::array<const char*, 5> all_slips{"boot", "stamp", "speed", "late", "twice"};
  switch (draw.below(9)) {
    case 0:
      return "ledger stall";
    case 1:
      return "ledger restart";
    case 2:
      return fmt::format("ledger {} {}stall", draw.of(ends), draw.of(ways));
    case 3:
      return fmt::format("ledger {} cut", draw.of(ends));
    case 4:
      return fmt::format("ledger {} stale", draw.of(ends));
    case 5:
      return fmt::format("ledger agent lies {}", draw.of(all_lies));
    case 6:
      return fmt::format("operator errs {}", draw.of(all_slips));
    default:
      return fmt::format("ledger {} {}delay {}", draw.of(ends), draw.of(ways), distribution(draw, recording, 1500));
  }
}

std::string sensor_fault(Draw& draw, const std::string& drone) {
  constexpr std::array<const char*, 5> fields{"h", "tof", "bat", "yaw", "all"};
  const std::string field = draw.of(fields);
  switch (draw.below(4)) {
    case 0:
      return fmt::format("sensor {} {} stuck", drone, field);
    case 1:
      return fmt::format("sensor {} {} garbage", drone, field);
    case 2:
      return fmt::format("sensor {} {} bias {:.0f}", drone, field == "all" ? "h" : field, draw.between(-60, 60));
    default:
      return fmt::format("sensor {} all every {}", drone, milliseconds(draw.between(200, 3000)));
  }
}

std::string mocap_fault(Draw& draw, const std::string& drone, const std::string& recording) {
  switch (draw.below(5)) {
    case 0:
      return fmt::format("mocap {} frozen", drone);
    case 1:
      return fmt::format("mocap {} jump {:.2f} {:.2f} {:.2f}", drone, draw.between(-1.5, 1.5), draw.between(-1.5, 1.5),
                         draw.between(-0.5, 0.5));
    case 2:
      return fmt::format("mocap {} noise {:.3f}", drone, draw.between(0.002, 0.1));
    case 3:
      return fmt::format("mocap {} every {}", drone, milliseconds(draw.between(20, 600)));
    default:
      return fmt::format("mocap {} {}", drone, effect(draw, recording));
  }
}

std::string what(Draw& draw, const std::string& drone, const std::string& recording) {
  constexpr std::array<const char*, 5> ways{"to", "answers", "states", "from", "both"};
  constexpr std::array<const char*, 3> processes{"agent", "link", "ground"};
  constexpr std::array<const char*, 4> halts{"agent stop", "link stop", "ground stop", "host suspend"};
  switch (draw.below(21)) {
    case 0:
      return fmt::format("drone {} reboot", drone);
    case 1:
      return fmt::format("drone {} battery {:.0f}%", drone, draw.between(4, 30));
    case 2:
      return fmt::format("drone {} drain {:.0f}%", drone, draw.between(1, 5));
    case 3:
      return fmt::format("drone {} propeller", drone);
    case 4:
      return fmt::format("drone {} kick {:.1f} {:.1f} {:.1f}", drone, draw.between(-2, 2), draw.between(-2, 2),
                         draw.between(-1, 1));
    case 5:
      return fmt::format("wind {:.1f} {:.1f} 0", draw.between(-2, 2), draw.between(-2, 2));
    case 6:
      return fmt::format("clock jump {}{}", draw.below(2) == 0 ? "-" : "", milliseconds(draw.between(10, 20'000)));
    case 7:
      return fmt::format("operator {} {}", draw.below(4) == 0 ? "cut" : "stop", drone);
    case 8:
    case 9:
      return fmt::format("{} kill", draw.of(processes));
    case 10:
    case 11:
      return draw.of(halts);
    case 12:
    case 13:
    case 14:
      return ledger_fault(draw, recording);
    case 15:
      return sensor_fault(draw, drone);
    case 16:
    case 17:
      return mocap_fault(draw, drone, recording);
    case 18:
      return fmt::format("drone {} plans {}", drone, effect(draw, recording, effects_of_memory));
    default:
      return fmt::format("drone {} {} {}", drone, draw.of(ways), effect(draw, recording));
  }
}

std::string moment(Draw& draw) {
  constexpr std::array<const char*, 7> triggers{"takeoff", "flying", "path", "path", "path", "height 0.5", "landing"};
  const std::string trigger = draw.of(triggers);
  if (draw.below(12) == 0) return milliseconds(draw.between(1, 5'000));
  const double max_ms = trigger == "path" ? 15'000 : 2'000;
  return fmt::format("{} + {}", trigger, milliseconds(draw.between(1, max_ms)));
}

void add(Script& script, const std::string& text, const std::string& at, double lasts_ms) {
  auto fault = parse_fault(text, at, milliseconds(lasts_ms));
  if (!fault) return;  // none of what is drawn is refused
  fault->optional = true;
  script.faults.push_back(std::move(*fault));
}

// Link dies, and its successor does not see the drone.
void add_blind_restart(Draw& draw, Script& script) {
  constexpr std::array<const char*, 3> deaf{"states", "from", "answers"};
  const std::string at = moment(draw);
  add(script, "link kill", at, draw.between(20, 2'500));
  add(script, fmt::format("drone * {} partition", draw.of(deaf)), at, draw.between(1'000, 40'000));
}

std::string sdk_fault(Draw& draw, const std::string& drone, bool another) {
  constexpr std::array<const char*, 7> answers{"late", "twice", "wrong", "garbage", "missing", "other", "shifted"};
  constexpr std::array<const char*, 3> states{"torn", "stale", "other"};
  constexpr std::array<const char*, 5> commands{"takeoff", "land", "command", "emergency", "*"};
  const std::string share = fmt::format(" {:.0f}%", draw.between(5, 100));
  if (draw.below(3) == 0) return fmt::format("sdk {} states {}{}", drone, states[draw.below(another ? 3 : 2)], share);
  const std::size_t which = draw.below(answers.size());
  const std::string time = which < 2 ? " " + milliseconds(draw, 10, 20'000) : "";
  return fmt::format("sdk {} answers {}{}{} to {}", drone, answers[which], time, share, draw.of(commands));
}

// In one of four: something is wrong at the SDK's own calls.
void add_sdk_faults(Draw& draw, Script& script) {
  if (draw.below(4) != 0) return;
  const std::size_t faults = 1 + draw.below(2);
  for (std::size_t i = 0; i < faults; ++i) {
    const std::string drone = drone_name(1 + static_cast<int>(draw.below(script.flight.drones)));
    const std::string text = sdk_fault(draw, drone, script.flight.drones > 1);
    const std::string at = draw.below(2) == 0 ? "1ms" : moment(draw);
    add(script, text, at, draw.below(3) == 0 ? draw.between(1'000, 60'000) : draw.between(100, 5'000));
  }
}

std::string sensing_fault(Draw& draw, const std::string& drone, bool pads) {
  switch (draw.below(pads ? 7 : 6)) {
    case 0:
      return fmt::format("drone {} flow lost", drone);
    case 1:
      return fmt::format("drone {} light {:.0f}%", drone, draw.between(0, 19));
    case 2:
      return fmt::format("drone {} floor {:.0f}%", drone, draw.between(0, 19));
    case 3:
      return fmt::format("drone {} flow bias {:.2f} {:.2f}", drone, draw.between(-0.4, 0.4), draw.between(0.01, 0.4));
    case 4:
      return fmt::format("drone {} tof nothing", drone);
    case 5:
      return fmt::format("drone {} baro drift {:.3f}", drone, draw.between(0.002, 0.1) * (draw.below(2) == 0 ? -1 : 1));
    default:
      return "pads gone";
  }
}

// Where drones look at first, by what they know where they are, and what becomes of their senses. Without motion
// capture its faults would do nothing: one of the senses comes in the place of each.
void add_senses(Draw& draw, Script& script) {
  WorldConfig& flight = script.flight;
  if (draw.below(2) == 0) flight.yaw_deg = static_cast<double>(draw.below(360)) - 180;
  const bool own = draw.below(3) == 0, pads = own && draw.below(2) == 0;
  if (own) flight.pose = pads ? link::PoseSource::pads : link::PoseSource::tello;
  if (!own && draw.below(3) == 0) flight.pose = link::PoseSource::mocap_then_tello;
  for (int id = 1; pads && id <= 4; ++id) {
    flight.pads.push_back({.id = id,
                           .x_m = id == 2 || id == 3 ? flight.side_m : 0,
                           .y_m = id > 2 ? flight.side_m : 0,
                           .yaw_rad = (static_cast<double>(draw.below(360)) - 180) * std::numbers::pi / 180});
  }
  const auto some_drone = [&] {
    return draw.below(4) == 0 ? "*" : drone_name(1 + static_cast<int>(draw.below(flight.drones)));
  };
  const auto some_ms = [&] { return draw.below(3) == 0 ? draw.between(1'000, 15'000) : draw.between(20, 3'000); };
  std::size_t wanted = own ? draw.below(3) : draw.below(4) == 0 ? 1 : 0;
  if (own) wanted += std::erase_if(script.faults, [](const Fault& fault) { return fault.text.starts_with("mocap "); });
  for (std::size_t i = 0; i < wanted; ++i) {
    const std::string text = sensing_fault(draw, some_drone(), pads), at = moment(draw);
    add(script, text, at, some_ms());
  }
}

// In half of all a drone that nobody knows; in one of six its firmware refuses, or protects itself.
void add_firmware(Draw& draw, Script& script) {
  script.flight.drawn_tello = draw.below(2) == 0;
  if (draw.below(6) != 0) return;
  const std::string drone = drone_name(1 + static_cast<int>(draw.below(script.flight.drones)));
  if (draw.below(2) == 0) {
    add(script, fmt::format("drone {} imu invalid", drone), "1ms", draw.between(100, 8'000));
  } else {
    auto hot = parse_fault(fmt::format("drone {} heat {:.0f}", drone, draw.between(96, 110)), moment(draw), "");
    if (!hot) return;
    hot->optional = true;
    script.faults.push_back(std::move(*hot));
  }
}

}  // namespace

Script draw_script(std::uint64_t number, const std::string& recording) {
  Draw draw(number * 7919 + 17);
  Script script;
  script.name = fmt::format("random-{}", number);
  script.title = fmt::format("Drawn at random, number {}", number);
  WorldConfig& flight = script.flight;
  flight.drones = draw.below(8) == 0 ? 2 : 1;
  constexpr std::array<ground::Shape, 4> shapes{ground::Shape::square, ground::Shape::triangle, ground::Shape::x,
                                                ground::Shape::eight};
  flight.shape = draw.of(shapes);
  // A lap of 20 s or so; with take-off and landing about 30 s.
  flight.speed_mps = draw.between(0.3, 1.0);
  const double lap_m = flight.side_m * (flight.shape == ground::Shape::triangle ? 3 : 4.4);
  flight.laps = std::max(1, static_cast<int>(18 * flight.speed_mps / lap_m));
  flight.predict = draw.below(4) != 0;
  if (draw.below(4) == 0) flight.max_age_ns = 3 * ns_per_s;
  constexpr std::array<double, 4> rates{10, 20, 30, 50};
  flight.rate_hz = draw.of(rates);
  constexpr std::array<std::size_t, 3> batches{1, 1, 10};
  flight.batch_count = draw.of(batches);
  flight.batch_timeout_ns =
      flight.batch_count > 1 ? static_cast<TimeNs>(draw.between(10, 200)) * ns_per_ms : 10 * ns_per_ms;
  script.limit_ns = 240 * ns_per_s;
  if (auto any_height = parse_rule("height below 100 m")) script.must.push_back(std::move(*any_height));  // kicks go up
  // Numbers of their own: what else is drawn stays as it was.
  Draw kind(number * 104'729 + 5);
  flight.keeps_rc = kind.below(2) == 0;
  flight.command_counts = kind.below(2) == 0;
  const std::size_t faults = 1 + draw.below(4);
  while (script.faults.size() < faults) {
    const std::string drone = draw.below(4) == 0 ? "*" : drone_name(1 + static_cast<int>(draw.below(flight.drones)));
    const std::string text = what(draw, drone, recording), at = moment(draw);
    const double lasts_ms = draw.below(3) == 0 ? draw.between(1'000, 15'000) : draw.between(20, 3'000);
    auto tried = parse_fault(text, at, "");
    if (!tried) continue;  // none of what is drawn is refused; a loop that ends shows it in the test
    auto fault = parse_fault(text, at, !tried->acts.momentary ? milliseconds(lasts_ms) : "");
    if (!fault) continue;
    fault->optional = true;  // one may keep the other's moment from coming
    script.faults.push_back(std::move(*fault));
  }
  if (kind.below(5) == 0) add_blind_restart(kind, script);
  Draw senses(number * 1'299'709 + 11);
  add_senses(senses, script);
  Draw sdk(number * 15'485'863 + 3);
  add_sdk_faults(sdk, script);
  Draw firmware(number * 32'452'843 + 7);
  add_firmware(firmware, script);
  return script;
}

}  // namespace ledgerline::hil
