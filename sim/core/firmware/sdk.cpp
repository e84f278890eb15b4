#include "sim/core/firmware/sdk.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>

namespace ledgerline::sim {
namespace {

constexpr std::size_t max_words = 12;
constexpr std::size_t max_command_bytes = 256;
constexpr const char* out_of_range = "out of range";
constexpr const char* auto_land = "error Auto land";
constexpr double radians = std::numbers::pi / 180;
constexpr int min_move_cm = 20, max_move_cm = 500;
constexpr int min_speed_cmps = 10, max_speed_cmps = 100, max_curve_cmps = 60;
constexpr double min_radius_m = 0.5, max_radius_m = 10;
constexpr double min_line_m = 0.02;  // nearer above a pad than this: it is there

std::optional<int> integer(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// All words as numbers, or nothing.
template <std::size_t N>
std::optional<std::array<int, N>> integers(std::span<const std::string_view> words) {
  if (words.size() != N) return std::nullopt;
  std::array<int, N> values{};
  for (std::size_t i = 0; i < N; ++i) {
    const auto value = integer(words[i]);
    if (!value) return std::nullopt;
    values[i] = *value;
  }
  return values;
}

bool within(int value, int low, int high) { return value >= low && value <= high; }

/// m1 to m8; -1 for m-1, -2 for m-2: any pad, and the nearest.
std::optional<int> pad_id(std::string_view word) {
  if (word.empty() || word[0] != 'm') return std::nullopt;
  const auto id = integer(word.substr(1));
  return id && (within(*id, 1, 8) || within(*id, -2, -1)) ? id : std::nullopt;
}

/// djitellopy takes any text with "ok" in it for a success, so the echo is left out of such a one.
std::string unknown(std::string_view name) {
  std::string echo;
  for (const char c : name)
    if (c > ' ' && c <= '~') echo += c;
  std::string lower = echo;
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
  if (lower.find("ok") != std::string::npos) echo.clear();
  return "unknown command: " + echo;
}

/// A point in centimetres: x forward, y left, z up. Each within 5 m, and not all within 20 cm of where the drone is.
bool point_in_range(int x, int y, int z) {
  const bool near = within(x, -min_move_cm, min_move_cm) && within(y, -min_move_cm, min_move_cm) &&
                    within(z, -min_move_cm, min_move_cm);
  return !near && within(x, -max_move_cm, max_move_cm) && within(y, -max_move_cm, max_move_cm) &&
         within(z, -max_move_cm, max_move_cm);
}

constexpr std::string_view questions[] = {
    "battery?", "speed?",        "time?", "wifi?",     "sdk?",    "sn?",          "height?", "temp?", "attitude?",
    "baro?",    "acceleration?", "tof?",  "hardware?", "active?", "wifiversion?", "ssid?",   "ap?"};

Vector metres(int x, int y, int z) { return Vector(x, y, z) / 100; }

/// From where the drone is to a point in the pad's frame: forward, left, up.
Vector from_drone(const Vector& on_pad, const PadSight& pad) {
  return Eigen::AngleAxisd(-pad.yaw_rad, Vector::UnitZ()) * (on_pad - pad.position);
}

}  // namespace

struct Sdk::Entry {
  std::string_view name;
  Answer (Sdk::*handle)(Call&);
  std::size_t min_arguments = 0, max_arguments = 0;
};

const Sdk::Entry* Sdk::find(std::string_view name) {
  static constexpr std::size_t any = max_words;
  static constexpr Entry table[] = {
      {"command", &Sdk::enter},
      {"rc", &Sdk::sticks, 0, any},
      {"takeoff", &Sdk::take_off},
      {"land", &Sdk::land},
      {"emergency", &Sdk::emergency},
      {"stop", &Sdk::stop},
      {"up", &Sdk::move, 1, 1},
      {"down", &Sdk::move, 1, 1},
      {"left", &Sdk::move, 1, 1},
      {"right", &Sdk::move, 1, 1},
      {"forward", &Sdk::move, 1, 1},
      {"back", &Sdk::move, 1, 1},
      {"cw", &Sdk::turn, 1, 1},
      {"ccw", &Sdk::turn, 1, 1},
      {"go", &Sdk::go, 4, 5},
      {"curve", &Sdk::curve, 7, 8},
      {"flip", &Sdk::flip, 1, 1},
      {"jump", &Sdk::jump, 7, 7},
      {"speed", &Sdk::set_speed, 1, 1},
      {"mon", &Sdk::pads},
      {"moff", &Sdk::pads},
      {"mdirection", &Sdk::pad_direction, 1, 1},
      {"keepalive", &Sdk::yes},
      {"streamon", &Sdk::yes},
      {"streamoff", &Sdk::yes},
      {"motoron", &Sdk::motors},
      {"motoroff", &Sdk::motors},
      {"throwfly", &Sdk::yes},
      {"port", &Sdk::set_ports, 2, 2},
      {"setfps", &Sdk::yes, 1, 1},
      {"setbitrate", &Sdk::yes, 1, 1},
      {"setresolution", &Sdk::yes, 1, 1},
      {"downvision", &Sdk::yes, 1, 1},
      {"ap", &Sdk::yes, 2, 2},
      {"wifi", &Sdk::yes, 2, 2},
      {"multiwifi", &Sdk::yes, 2, 2},
      {"wifisetchannel", &Sdk::yes, 1, 1},
      {"EXT", &Sdk::yes, 1, any},
      {"reboot", &Sdk::reboot},
      {"battery?", &Sdk::query},  // and all other questions
  };
  const bool asks = std::find(std::begin(questions), std::end(questions), name) != std::end(questions);
  const auto* found = std::find_if(std::begin(table), std::end(table),
                                   [&](const Entry& e) { return e.name == (asks ? "battery?" : name); });
  return found == std::end(table) ? nullptr : found;
}

Sdk::Sdk(const Parameters& parameters, DroneNumber number)
    : p_(parameters), number_(number), speed_cmps_(parameters.sdk.default_speed_cmps) {}

void Sdk::send(Endpoint to, std::string text, std::vector<Outgoing>& out) const {
  out.push_back({number_, to, std::move(text)});
}

void Sdk::receive(TimeNs now, Endpoint from, std::string_view bytes, Drone drone, std::vector<Outgoing>& out) {
  if (switched_off_) return;
  if (p_.sdk.command_latency_s <= 0) return act(now, from, bytes, drone, out);
  heard_.push(now + from_seconds(p_.sdk.command_latency_s), from, std::string(bytes));
}

void Sdk::act(TimeNs now, Endpoint from, std::string_view bytes, Drone drone, std::vector<Outgoing>& out) {
  std::array<std::string_view, max_words + 1> words;
  std::size_t count = 0;
  constexpr std::string_view space = " \t\r\n";
  bool fits = bytes.size() <= max_command_bytes;
  for (std::size_t at = bytes.find_first_not_of(space); fits && at != std::string_view::npos;) {
    const std::size_t end = std::min(bytes.find_first_of(space, at), bytes.size());
    if (count == words.size()) {
      fits = false;
    } else {
      words[count++] = bytes.substr(at, end - at);
      at = bytes.find_first_not_of(space, end);
    }
  }
  if (fits && count == 0) return;
  if (!sdk_mode_ && !(fits && count == 1 && words[0] == "command")) return;

  if (!sdk_mode_ || p_.sdk.command_counts || !fits || words[0] != "command") last_heard_ = now;
  if (!fits) return send(from, "error", out);
  const Entry* entry = find(words[0]);
  if (!entry) return send(from, unknown(words[0]), out);
  Call call{now, from, words[0], std::span(words).subspan(1, count - 1), drone, out};
  const bool counted = within(static_cast<int>(count) - 1, static_cast<int>(entry->min_arguments),
                              static_cast<int>(entry->max_arguments));
  Answer answer = counted ? (this->*entry->handle)(call) : Answer("error");
  if (!answer.empty()) send(from, std::move(answer), out);
}

void Sdk::step(TimeNs now, Drone drone, std::vector<Outgoing>& out) {
  if (drone.sensors.overheated() && drone.pilot.phase() == Pilot::Phase::off) {
    drone.pilot.idle_motors(false);
    switched_off_ = true;
  }
  if (switched_off_) return;
  while (const auto text = heard_.pop(now)) act(now, text->end, text->bytes, drone, out);
  if (const auto end = drone.pilot.pop_end(); end && waiting_) {
    const char* answer = *end == Pilot::End::reached      ? "ok"
                         : *end == Pilot::End::broken_off ? "error"
                                                          : "error Motor stop";
    send(*waiting_, answer, out);
    waiting_.reset();
  }
  if (!sdk_mode_) return;

  if (drone.pilot.busy()) last_heard_ = now;
  if (!p_.sdk.keeps_rc && sticks_since_ && now - *sticks_since_ > from_seconds(p_.sdk.rc_lasts_s)) {
    sticks_since_.reset();
    drone.pilot.sticks(Vector::Zero(), 0);
  }
  protect_itself(now, drone, out);
  if (now >= next_state_) {
    next_state_ += from_seconds(1 / p_.sdk.state_hz);
    state_texts_.push(now + from_seconds(p_.sdk.state_latency_s), {state_to_.address, state_port_},
                      state_text(telemetry(drone), pads_wanted_));
  }
  while (auto text = state_texts_.pop(now)) send(text->end, std::move(text->bytes), out);
}

void Sdk::protect_itself(TimeNs now, Drone& drone, std::vector<Outgoing>& out) {
  using Phase = Pilot::Phase;
  const bool silent = now - last_heard_ > from_seconds(p_.sdk.silence_s);
  const bool is_low = drone.sensors.battery() < p_.battery.land_below;
  if ((silent || is_low || drone.sensors.overheated()) && drone.pilot.phase() == Phase::flying) {
    if (waiting_) send(*waiting_, auto_land, out);
    waiting_.reset();
    drone.pilot.land();
    lands_by_itself_ = true;
  }
  if (drone.sensors.charge() <= 0 && drone.pilot.phase() != Phase::off) drone.pilot.cut();
  if (drone.pilot.phase() == Phase::off) lands_by_itself_ = false;
}

Telemetry Sdk::telemetry(const Drone& drone) const {
  const Flow& flow = drone.pilot.flow();
  Telemetry t = drone.sensors.read(
      drone.body, {flow.reported(), flow.lost(), drone.pilot.takeoff_z(), drone.pilot.motor_seconds()});
  if (pads_wanted_ && looks_down_) t.pad = drone.sensors.pad(drone.body);
  return t;
}

std::optional<PadSight> Sdk::pad_called(std::string_view word, const Drone& drone) const {
  if (!pads_wanted_ || !looks_down_) return std::nullopt;
  auto seen = drone.sensors.pad(drone.body);
  const auto id = pad_id(word);
  return seen && id && (*id < 0 || *id == seen->id) ? seen : std::nullopt;
}

void Sdk::break_off(Call& call, const char* why) {
  if (waiting_) send(*waiting_, why, call.out);
  waiting_.reset();
}

Sdk::Answer Sdk::wait(const Call& call) {
  waiting_ = call.from;
  return {};
}

Sdk::Answer Sdk::refusal(const Call& call) const {
  if (call.drone.pilot.phase() == Pilot::Phase::off) return "error Motor stop";
  if (lands_by_itself_) return auto_land;
  if (call.drone.pilot.busy()) return "error Not joystick";
  return {};
}

Sdk::Answer Sdk::enter(Call& call) {
  if (!sdk_mode_) next_state_ = call.now;
  sdk_mode_ = true;
  state_to_ = call.from;
  return "ok";
}

Sdk::Answer Sdk::yes(Call&) { return "ok"; }

Sdk::Answer Sdk::take_off(Call& call) {
  if (call.drone.sensors.battery() < p_.battery.no_takeoff_below) return "error";
  if (lands_by_itself_) return auto_land;
  if (call.drone.pilot.phase() != Pilot::Phase::off) return "error";
  if (!call.drone.sensors.sensing().imu || call.now - on_since_ < from_seconds(p_.control.imu_ready_s))
    return "error No valid imu";
  if (!call.drone.pilot.takeoff(call.drone.body)) return "error Motor stop";  // it lies on its side
  return wait(call);
}

Sdk::Answer Sdk::land(Call& call) {
  if (call.drone.pilot.phase() == Pilot::Phase::off) return "ok";
  if (call.drone.pilot.phase() != Pilot::Phase::flying) return {};
  break_off(call, "error");
  call.drone.pilot.land();
  return wait(call);
}

Sdk::Answer Sdk::emergency(Call& call) {
  break_off(call, "error Motor stop");
  call.drone.pilot.cut();
  return "ok";
}

Sdk::Answer Sdk::stop(Call& call) {
  if (call.drone.pilot.phase() == Pilot::Phase::flying) {
    break_off(call, "error");
    call.drone.pilot.hover();
  }
  return "ok";
}

Sdk::Answer Sdk::sticks(Call& call) {
  const auto values = integers<4>(call.arguments);
  if (!values) return {};
  const auto [right, forward, up, clockwise] = *values;
  for (const int value : *values)
    if (!within(value, -100, 100)) return {};
  sticks_since_ = call.now;
  const double full = p_.sdk.rc_full_mps / 100;
  call.drone.pilot.sticks(Vector(forward, -right, up) * full, -clockwise * p_.sdk.rc_full_yaw_degps / 100 * radians);
  return {};
}

Sdk::Answer Sdk::move(Call& call) {
  const auto distance = integer(call.arguments[0]);
  if (!distance) return "error";
  if (!within(*distance, min_move_cm, max_move_cm)) return out_of_range;
  if (auto why = refusal(call); !why.empty()) return why;
  const Vector axis = call.name == "up" || call.name == "down"      ? Vector::UnitZ()
                      : call.name == "left" || call.name == "right" ? Vector::UnitY()
                                                                    : Vector::UnitX();
  const bool back = call.name == "down" || call.name == "right" || call.name == "back";
  const Vector direction = back ? Vector(-axis) : axis;
  if (!call.drone.pilot.line(direction * *distance / 100.0, speed_cmps_ / 100)) return "error";
  return wait(call);
}

Sdk::Answer Sdk::turn(Call& call) {
  const auto angle = integer(call.arguments[0]);
  if (!angle) return "error";
  if (!within(*angle, 1, p_.sdk.max_turn_deg)) return out_of_range;
  if (auto why = refusal(call); !why.empty()) return why;
  const double sign = call.name == "ccw" ? 1 : -1;
  if (!call.drone.pilot.turn(sign * *angle * radians, p_.sdk.turn_degps * radians)) return "error";
  return wait(call);
}

Sdk::Answer Sdk::go(Call& call) {
  const bool pad = call.arguments.size() == 5;
  const auto values = integers<4>(call.arguments.first(4));
  if (!values || (pad && !pad_id(call.arguments[4]))) return "error";
  const auto [x, y, z, speed] = *values;
  if (!point_in_range(x, y, z) || !within(speed, min_speed_cmps, max_speed_cmps)) return out_of_range;
  if (auto why = refusal(call); !why.empty()) return why;
  Vector offset = metres(x, y, z);
  if (pad) {
    const auto seen = pad_called(call.arguments[4], call.drone);
    if (!seen) return "error";
    offset = from_drone(offset, *seen);
    if (offset.norm() < min_line_m) return "ok";
  }
  if (!call.drone.pilot.line(offset, speed / 100.0)) return "error";
  return wait(call);
}

Sdk::Answer Sdk::curve(Call& call) {
  const bool pad = call.arguments.size() == 8;
  const auto values = integers<7>(call.arguments.first(7));
  if (!values || (pad && !pad_id(call.arguments[7]))) return "error";
  const auto [x1, y1, z1, x2, y2, z2, speed] = *values;
  if (!point_in_range(x1, y1, z1) || !point_in_range(x2, y2, z2) || !within(speed, min_speed_cmps, max_curve_cmps))
    return out_of_range;
  Vector via = metres(x1, y1, z1), end = metres(x2, y2, z2);
  if (pad) {
    const auto seen = pad_called(call.arguments[7], call.drone);
    if (!seen) return "error";
    via = from_drone(via, *seen);
    end = from_drone(end, *seen);
  }
  const auto arc = Path::arc(Vector::Zero(), via, end);
  if (!arc || arc->radius() < min_radius_m || arc->radius() > max_radius_m) return "error";
  if (auto why = refusal(call); !why.empty()) return why;
  if (!call.drone.pilot.arc(via, end, speed / 100.0)) return "error";
  return wait(call);
}

Sdk::Answer Sdk::flip(Call& call) {
  static const std::pair<std::string_view, Vector> directions[] = {
      {"l", -Vector::UnitX()}, {"r", Vector::UnitX()}, {"f", Vector::UnitY()}, {"b", -Vector::UnitY()}};
  const auto* direction = std::find_if(std::begin(directions), std::end(directions),
                                       [&](const auto& d) { return d.first == call.arguments[0]; });
  if (direction == std::end(directions)) return "error";
  if (auto why = refusal(call); !why.empty()) return why;
  if (call.drone.sensors.battery() < p_.battery.flip_above) return "error";
  if (!call.drone.pilot.flip(direction->second)) return "error";
  return wait(call);
}

Sdk::Answer Sdk::jump(Call&) { return "error"; }

Sdk::Answer Sdk::set_speed(Call& call) {
  const auto speed = integer(call.arguments[0]);
  if (!speed) return "error";
  if (!within(*speed, min_speed_cmps, max_speed_cmps)) return out_of_range;
  speed_cmps_ = *speed;
  return "ok";
}

Sdk::Answer Sdk::pads(Call& call) {
  pads_wanted_ = call.name == "mon";
  looks_down_ = true;
  return "ok";
}

Sdk::Answer Sdk::pad_direction(Call& call) {
  const auto direction = integer(call.arguments[0]);
  if (!direction) return "error";
  if (!within(*direction, 0, 2)) return out_of_range;
  looks_down_ = *direction != 1;
  return "ok";
}

Sdk::Answer Sdk::motors(Call& call) { return call.drone.pilot.idle_motors(call.name == "motoron") ? "ok" : "error"; }

Sdk::Answer Sdk::set_ports(Call& call) {
  const auto ports = integers<2>(call.arguments);
  if (!ports) return "error";
  for (const int port : *ports)
    if (!within(port, 1025, 65535)) return out_of_range;
  state_port_ = static_cast<std::uint16_t>((*ports)[0]);
  return "ok";
}

Sdk::Answer Sdk::reboot(Call& call) {
  // On the ground only: afterwards it waits for `command` as after switching on.
  if (call.drone.pilot.phase() != Pilot::Phase::off) return "error";
  call.drone.sensors.power_on(call.drone.body);
  restart(call.now);
  return {};
}

void Sdk::restart(TimeNs now) {
  sdk_mode_ = false;
  switched_off_ = lands_by_itself_ = false;
  on_since_ = now;
  heard_.clear();
  state_texts_.clear();
  pads_wanted_ = false;
  looks_down_ = true;
  state_port_ = state_port;
  speed_cmps_ = p_.sdk.default_speed_cmps;
  sticks_since_.reset();
  waiting_.reset();
}

Sdk::Answer Sdk::query(Call& call) {
  const Telemetry t = telemetry(call.drone);
  const auto text = [&]() -> std::string {
    if (call.name == "battery?") return fmt::format("{}", t.battery_percent);
    if (call.name == "speed?") return fmt::format("{:.1f}", speed_cmps_);
    if (call.name == "time?") return fmt::format("{}s", t.motor_time_s);
    if (call.name == "wifi?") return "90";
    if (call.name == "sdk?") return "20";
    if (call.name == "sn?") return fmt::format("0TQDG00SIM{:04}", p_.sdk.first_serial + number_ - 1);
    if (call.name == "height?") return fmt::format("{}dm", t.height_dm);
    if (call.name == "temp?") return fmt::format("{}~{}C", t.temperature_low_c, t.temperature_high_c);
    if (call.name == "attitude?") return fmt::format("pitch:{};roll:{};yaw:{};", t.pitch_deg, t.roll_deg, t.yaw_deg);
    if (call.name == "baro?") return fmt::format("{:.6f}", t.barometer_m);
    if (call.name == "acceleration?")
      return fmt::format("agx:{:.2f};agy:{:.2f};agz:{:.2f};", t.acceleration_mg[0], t.acceleration_mg[1],
                         t.acceleration_mg[2]);
    if (call.name == "tof?") return fmt::format("{}mm", t.tof_mm);
    if (call.name == "hardware?") return "TELLO";
    if (call.name == "active?") return "active";
    if (call.name == "wifiversion?") return "wifiv1.0.0.0";
    return fmt::format("TELLO-SIM{:03}", number_);  // ssid? and ap?
  }();
  return text + "\r\n";  // as the firmware ends values, not ok
}

}  // namespace ledgerline::sim
