#pragma once
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "sim/core/firmware/pilot.hpp"
#include "sim/core/sensors.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::sim {

/// The Tello SDK 2.0 endpoint of one drone (and of SDK 3 what clients send): text in, text out. Facts with their
/// sources: docs/sources.md. Where the firmware's behaviour is not known, this one is assumed:
/// - nothing but `command` is heard, or answered, before the first `command`;
/// - each answered command gets exactly one answer; a move's comes when it ends, `error` when `land` or `stop` broke
///   it off;
/// - while it lands by itself (silence, battery, heat), moves and `takeoff` are refused with `error Auto land`, and one
///   that it breaks off ends with it;
/// - `takeoff` without a valid IMU (just switched on, or broken) answers `error No valid imu`;
/// - too hot, it lands and then switches itself off: it hears and says nothing until restart();
/// - a move while another action runs is refused with `error Not joystick`, one on the ground with `error Motor stop`;
/// - the 15 s of silence begin when the last action ends;
/// - `land` is ignored, without an answer, during takeoff and while it is landing already, and `ok` on the ground;
/// - `rc` counts as a sign of life always, steers only when flying without a move, and is dropped whole if malformed;
///   it is flown until the next one comes, and `command` counts as a sign of life: SdkParameters can have it otherwise;
/// - `go` and `curve` with a mission pad need that one (`m-1`, `m-2`: any) in sight when they begin, otherwise they
///   answer `error`; they then fly by odometry. `jump` always answers `error`;
/// - `mdirection 1` looks forward only, where no pad is; `mon` looks both ways;
/// - `streamon` answers `ok` but NO VIDEO IS SENT.
class Sdk {
 public:
  /// What the endpoint acts on.
  struct Drone {
    Pilot& pilot;
    Sensors& sensors;
    const Body& body;
  };
  Sdk(const Parameters& parameters, DroneNumber number);

  /// Acted on SdkParameters::command_latency_s later, by step(); without one, now.
  void receive(TimeNs now, Endpoint from, std::string_view bytes, Drone drone, std::vector<Outgoing>& out);
  /// Every millisecond: ends of moves, the end of an rc (where none is kept: SdkParameters), landing after silence or
  /// on a low battery, motors off on an empty one, state.
  void step(TimeNs now, Drone drone, std::vector<Outgoing>& out);
  /// As after switching on: only `command` is heard, and nobody waits for an answer.
  void restart(TimeNs now);

 private:
  struct Call {
    TimeNs now;
    Endpoint from;
    std::string_view name;
    std::span<const std::string_view> arguments;
    Drone drone;
    std::vector<Outgoing>& out;
  };
  struct Entry;
  /// What a handler says; empty: nothing (yet).
  using Answer = std::string;

  /// What comes out later than it went in.
  class Later {
   public:
    struct Text {
      TimeNs due = 0;
      Endpoint end;
      std::string bytes;
    };
    void push(TimeNs due, Endpoint end, std::string bytes) { texts_.push_back({due, end, std::move(bytes)}); }
    std::optional<Text> pop(TimeNs now) {
      if (texts_.empty() || texts_.front().due > now) return std::nullopt;
      Text text = std::move(texts_.front());
      texts_.pop_front();
      return text;
    }
    void clear() { texts_.clear(); }

   private:
    std::deque<Text> texts_;
  };

  static const Entry* find(std::string_view name);
  void act(TimeNs now, Endpoint from, std::string_view bytes, Drone drone, std::vector<Outgoing>& out);
  /// Lands by itself where something makes it.
  void protect_itself(TimeNs now, Drone& drone, std::vector<Outgoing>& out);
  void send(Endpoint to, std::string text, std::vector<Outgoing>& out) const;
  void break_off(Call& call, const char* why);
  /// After a request that the pilot took: the answer comes at its end.
  Answer wait(const Call& call);
  /// Why a move cannot begin now; empty: it can.
  Answer refusal(const Call& call) const;
  Telemetry telemetry(const Drone& drone) const;
  /// The pad that `word` (m1, m-2) names, if it is in sight.
  std::optional<PadSight> pad_called(std::string_view word, const Drone& drone) const;

  Answer enter(Call& call);
  Answer yes(Call& call);
  Answer take_off(Call& call);
  Answer land(Call& call);
  Answer emergency(Call& call);
  Answer stop(Call& call);
  Answer sticks(Call& call);
  Answer move(Call& call);
  Answer turn(Call& call);
  Answer go(Call& call);
  Answer curve(Call& call);
  Answer flip(Call& call);
  Answer jump(Call& call);
  Answer set_speed(Call& call);
  Answer pads(Call& call);
  Answer pad_direction(Call& call);
  Answer motors(Call& call);
  Answer set_ports(Call& call);
  Answer reboot(Call& call);
  Answer query(Call& call);

  Parameters p_;
  DroneNumber number_;
  bool sdk_mode_ = false;
  bool switched_off_ = false, lands_by_itself_ = false;
  TimeNs on_since_ = 0;
  Later heard_, state_texts_;
  Endpoint state_to_;
  std::uint16_t state_port_ = state_port;
  TimeNs next_state_ = 0;
  TimeNs last_heard_ = 0;
  std::optional<TimeNs> sticks_since_;  ///< the newest rc that steers, until it lasts no longer
  double speed_cmps_;
  bool pads_wanted_ = false, looks_down_ = true;
  /// Who waits for the end of the action that runs.
  std::optional<Endpoint> waiting_;
};

}  // namespace ledgerline::sim
