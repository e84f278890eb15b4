#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "onboard/link/core/link_core.hpp"

namespace ledgerline::link {

/// The least that a drone must do for link: it answers, climbs, sinks, and moves as rc says, without inertia. A test
/// may silence each of its voices.
struct FakeTello {
  DroneNumber number = 1;
  bool connected = false;
  bool answers = true, states = true;
  bool hears = true, lands = true;              ///< lands: when commanded to
  bool keeps_rc = true, command_counts = true;  ///< as sim::SdkParameters
  double at_s = 0, heard_at_s = 0, steered_at_s = 0;
  enum class Motion { ground, spinning_up, climbing, hovering, sinking } motion = Motion::ground;
  std::array<double, 3> position{};
  double yaw = 0;
  std::array<int, 4> rc{};
  int battery = 90;
  double height_error_m = 0;  ///< of `h`, as a barometer drifts
  std::string attitude_text;
  bool tells_velocity = false;           ///< in the frame that it had when it was made
  std::array<double, 3> velocity_mps{};  ///< in that frame, of the newest step
  double spin_up_s = 1.5, spun_s = 0;    // from `takeoff` until it leaves the ground
  std::vector<std::string> heard;
  std::vector<std::string> answer_queue;

  void hear(std::string_view text) {
    if (!hears) return;
    heard.emplace_back(text);
    if (!connected || command_counts || text != "command") heard_at_s = at_s;
    if (text == "command") {
      connected = true;
      say("ok");
    } else if (text == "takeoff") {
      if (motion == Motion::ground) motion = Motion::spinning_up, spun_s = 0;
    } else if (text == "land") {
      if (motion == Motion::hovering && lands) motion = Motion::sinking;
    } else if (text == "emergency") {
      motion = Motion::ground;
      position[2] = 0;
      say("ok");
    } else if (motion == Motion::hovering) {
      std::sscanf(std::string(text).c_str(), "rc %d %d %d %d", &rc[0], &rc[1], &rc[2], &rc[3]);
      steered_at_s = at_s;
    }
  }
  void move(double dt) {
    at_s += dt;
    if (motion == Motion::spinning_up || motion == Motion::climbing) heard_at_s = at_s;
    if (motion == Motion::hovering && at_s - heard_at_s > 15) motion = Motion::sinking;
    if (!keeps_rc && at_s - steered_at_s > 0.5) rc = {};
    if (motion == Motion::spinning_up && (spun_s += dt) >= spin_up_s) motion = Motion::climbing;
    if (motion == Motion::climbing && (position[2] += 0.5 * dt) >= 1) {
      motion = Motion::hovering;
      rc = {};
      say("ok");
    } else if (motion == Motion::sinking && (position[2] -= 0.5 * dt) <= 0) {
      position[2] = 0;
      motion = Motion::ground;
      say("ok");
    } else if (motion == Motion::hovering) {
      const double forward = rc[1] / 100.0, left = -rc[0] / 100.0;
      position[0] += (std::cos(yaw) * forward - std::sin(yaw) * left) * dt;
      position[1] += (std::sin(yaw) * forward + std::cos(yaw) * left) * dt;
      position[2] += rc[2] / 100.0 * dt;
    }
  }
  void say(const char* text) {
    if (answers) answer_queue.emplace_back(text);
  }
  std::string state_text() const {
    return "tof:" + std::to_string(static_cast<int>(position[2] * 100) + 10) +
           ";h:" + std::to_string(static_cast<int>((position[2] + height_error_m) * 10) * 10) +
           ";bat:" + std::to_string(battery) + ";" + attitude_text + (tells_velocity ? velocity_text() : "");
  }
  std::string velocity_text() const {
    const auto sent = [](double mps) { return std::to_string(std::lround(10 * mps)); };
    return "vgx:" + sent(velocity_mps[0]) + ";vgy:" + sent(velocity_mps[1]) + ";vgz:" + sent(velocity_mps[2]) +
           ";yaw:0;";
  }
  /// It is sent zero, or no more than what keeps its place: 0.3 m/s level, and as much upward.
  bool keeps_place() const { return std::hypot(rc[0], rc[1]) <= 31 && std::abs(rc[2]) <= 31 && rc[3] == 0; }
  long count(const std::string& command) const { return std::count(heard.begin(), heard.end(), command); }
};

/// LinkCore, its drones and its agent on a simulated clock.
class LinkWorld {
 public:
  explicit LinkWorld(std::size_t drones = 1, LinkSettings settings = {})
      : settings_(with_drones(settings, drones)), core(settings_, 42) {
    tellos.resize(drones);
    for (std::size_t i = 0; i < drones; ++i) {
      tellos[i].number = static_cast<DroneNumber>(i + 1);
      tellos[i].position[0] = 3 * static_cast<double>(i);
    }
  }

  void pass(TimeNs duration) {
    for (const TimeNs end = now + duration; now < end;) step();
  }

  void step() {
    now += tick;
    std::vector<std::string> texts;
    std::vector<Received> received;
    std::vector<Pose> poses;
    texts.reserve(64);
    for (FakeTello& tello : tellos) {
      const std::array<double, 3> before = tello.position;
      tello.move(to_seconds(tick));
      std::array<double, 3> velocity{};
      for (std::size_t i = 0; i < 3; ++i) velocity[i] = (tello.position[i] - before[i]) / to_seconds(tick);
      const double c = std::cos(tello.yaw), s = std::sin(tello.yaw);
      tello.velocity_mps = {c * velocity[0] + s * velocity[1], c * velocity[1] - s * velocity[0], velocity[2]};
      for (std::string& answer : tello.answer_queue) {
        texts.push_back(std::move(answer));
        received.push_back({tello.number, Port::answer, texts.back()});
      }
      tello.answer_queue.clear();
      if (tello.connected && tello.states && now % (100 * ns_per_ms) == 0) {
        texts.push_back(tello.state_text());
        received.push_back({tello.number, Port::state, texts.back()});
      }
      if (mocap && now % (10 * ns_per_ms) == 0) {
        measured.push_back({.drone = tello.number,
                            .stamp_ns = now,
                            .position_m = tello.position,
                            .velocity_mps = velocity,
                            .yaw_rad = tello.yaw});
      }
    }
    for (; !measured.empty() && now - measured.front().stamp_ns >= mocap_late_ns; measured.pop_front())
      poses.push_back(measured.front());
    std::vector<AgentHeartbeat> heartbeats;
    if (agent && now % (50 * ns_per_ms) == 0) {
      heartbeat.stamp_ns = now;
      heartbeat.ledger_alive = ledger;
      heartbeats.push_back(heartbeat);
    }
    const LinkOutputs& out = core.step(now, {.received = received,
                                             .plans = plans,
                                             .poses = poses,
                                             .heartbeats = heartbeats,
                                             .stop_all = stop_all,
                                             .suspended_ns = suspended_ns,
                                             .clear_local_stops = clear_local_stops});
    clear_local_stops = false;
    plans.clear();
    for (const ToSend& message : out.to_send) {
      sent.emplace_back(now, std::string(message.command.view()));
      tellos[message.drone - 1].hear(message.command.view());
    }
    for (const StateSample& state : out.states) states.push_back(state);
    for (const Transition& transition : out.transitions) transitions.push_back(transition);
    for (const TraceRecord& record : out.trace) trace.push_back(record);
  }

  /// A plan with the next sequence number, made from a state of this moment.
  Plan& plan(PlanAction action, std::size_t drone = 1) {
    plans.push_back({});
    Plan& plan = plans.back();
    plan.drone = static_cast<DroneNumber>(drone);
    plan.action = action;
    plan.epoch = 1;
    plan.sequence = ++sequence;
    plan.state_stamp_ns = plan.verified_ns = now;
    return plan;
  }
  /// `count` setpoints 50 ms apart, the first `in` from now.
  Plan& fly_plan(const std::array<float, 3>& velocity, std::uint32_t count = 10, TimeNs in = 0, std::size_t drone = 1) {
    Plan& made = plan(PlanAction::fly, drone);
    made.count = count;
    for (std::uint32_t i = 0; i < count; ++i) made.setpoints[i] = {now + in + i * 50 * ns_per_ms, velocity, 0};
    return made;
  }
  void take_off() {
    pass(ns_per_s);
    for (std::size_t i = 1; i <= tellos.size(); ++i) plan(PlanAction::takeoff, i);
    for (int i = 0; i < 4000 && core.phase(1) != LinkPhase::flying; ++i) step();
  }

  /// Those that `settings` has not are as any other.
  static LinkSettings with_drones(LinkSettings settings, std::size_t drones) {
    if (!settings.drones.empty()) return settings;
    for (std::size_t i = settings.drones.size() + 1; i <= drones; ++i) {
      settings.drones.push_back({"tello" + std::to_string(i), static_cast<DroneNumber>(i)});
    }
    return settings;
  }

  static constexpr TimeNs tick = ns_per_ms;
  LinkSettings settings_;
  LinkCore core;
  std::vector<FakeTello> tellos;
  TimeNs now = 1000 * ns_per_s;
  std::uint64_t sequence = 0;
  std::vector<Plan> plans;
  bool mocap = true, agent = true, ledger = true, stop_all = false;
  bool clear_local_stops = false;  ///< once
  TimeNs suspended_ns = 0;         ///< since the host booted; `now` stands still meanwhile
  TimeNs mocap_late_ns = 0;        ///< from a pose's stamp until link has it
  std::deque<Pose> measured;       ///< on their way
  std::vector<std::pair<TimeNs, std::string>> sent;
  std::vector<StateSample> states;
  std::vector<Transition> transitions;
  AgentHeartbeat heartbeat;  ///< what else it says
  std::vector<TraceRecord> trace;
};

}  // namespace ledgerline::link
