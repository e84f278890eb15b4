#pragma once
#include <array>

#include "common/msg/onboard.hpp"
#include "common/rt/clock.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// Whether a drone in the air is tilted beyond what flying needs, and whether it lies on its back or side: then its
/// motors only do harm. The two are distinguished by gravity: a flying drone's accelerometer feels its thrust, along
/// its own up, however it is tilted; a lying one feels the ground's push, which is not. Core; one thread.
class TiltWatch {
 public:
  /// A Tello tilts by 0.5 rad at most when it is flown hard, and its own controller gives up near 1.2.
  static constexpr double tilted_rad = 1.05;
  /// Three texts: one alone may be a knock.
  static constexpr TimeNs tilted_for_ns = 200 * ns_per_ms;
  static constexpr TimeNs overturned_for_ns = 1 * ns_per_s;
  /// On the ground: a drone on a slope or on something does not rise straight. About 17 degrees.
  static constexpr double no_takeoff_rad = 0.3;

  /// A state text that came at `now`.
  void update(TimeNs now, const TelloState& state) noexcept;
  double tilt_rad() const noexcept { return tilt_rad_; }
  bool is_tilted() const noexcept { return tilted_since_ns_ != 0 && text_ns_ - tilted_since_ns_ >= tilted_for_ns; }
  bool is_overturned() const noexcept { return lies_since_ns_ != 0 && text_ns_ - lies_since_ns_ >= overturned_for_ns; }

 private:
  double tilt_rad_ = 0;
  TimeNs text_ns_ = 0, tilted_since_ns_ = 0, lies_since_ns_ = 0;
};

/// What share of its battery a drone needs to land from where it is, by how fast it has emptied recently. A Tello
/// reports whole percents, so the rate is taken over seconds. Core; one thread.
class BatteryWatch {
 public:
  /// Kept for behind the landing: at 5 % a Tello lands by itself, or falls.
  static constexpr double reserve = 0.05;
  static constexpr double landing_mps = 0.5;    ///< as a Tello sinks (docs/sources.md)
  static constexpr double landing_takes_s = 2;  ///< besides: until it begins, and the last centimetres
  /// Long enough for several steps of a percent where it matters; a full battery loses one in eight seconds.
  static constexpr TimeNs window_ns = 10 * ns_per_s;

  /// A state text in flight that came at `now`.
  void update(TimeNs now, float battery) noexcept;
  void reset() noexcept { *this = {}; }
  /// Share of a full battery below which it must land now, from `height_m`.
  double needed(float height_m) const noexcept;

 private:
  TimeNs since_ns_ = 0;
  float at_since_ = 0, newest_ = 0;
  double rate_per_s_ = 0;
};

/// Whether a drone is too hot. In flight its rotors cool it and it says up to 88 degrees; on the ground nothing does,
/// and users report Tellos that switched themselves off there after some minutes (docs/sources.md). Core; one thread.
class HeatWatch {
 public:
  static constexpr float warm_c = 85;         ///< beyond it on the ground: half of the way is what a room does
  static constexpr float warm_in_air_c = 90;  ///< beyond what it says there all the time
  static constexpr float margin_c = 3;        ///< its two values are 3 apart: a warning ends below both

  void update(const TelloState& state, bool flies) noexcept {
    const float limit_c = flies ? warm_in_air_c : warm_c;
    hot_ = state.temperature_c > (hot_ ? limit_c - margin_c : limit_c);
  }
  bool is_hot() const noexcept { return hot_; }

 private:
  bool hot_ = false;
};

/// Whether another client commands this drone as well: a Tello sends its state texts to the client that sent `command`
/// last, so a link of another host with this drone's address, or a tool, silently takes them away. Two signs, of which
/// neither is a proof:
///
///     contested   twice within a minute its texts, away for seconds, came back with link's own `command`. Radio that
///                 is back brings texts by itself, and a drone that was switched off and on does so once
///     diverted    it answers, but no text comes: taken away, or held back by a firewall
///
/// Core; one thread.
class ClientWatch {
 public:
  static constexpr TimeNs away_ns = 2 * ns_per_s;        ///< twenty texts; half is a bad moment of radio
  static constexpr TimeNs at_once_ns = 300 * ns_per_ms;  ///< behind `command`: two texts and a way there and back
  /// Links that fight over a drone take turns: half of this is two of their rounds.
  static constexpr TimeNs within_ns = 60 * ns_per_s;

  void on_command(TimeNs now) noexcept { command_ns_ = now; }
  void on_text(TimeNs now) noexcept;
  void on_answer(TimeNs now) noexcept;

  bool is_contested(TimeNs now) const noexcept { return returned_ns_[1] != 0 && now - returned_ns_[1] < within_ns; }
  bool is_diverted(TimeNs now) const noexcept {
    return answered_ns_ > text_ns_ && text_ns_ != 0 && now - answered_ns_ > at_once_ns;
  }

 private:
  TimeNs text_ns_ = 0, command_ns_ = 0;
  TimeNs answered_ns_ = 0;               ///< the first answer since texts were away
  std::array<TimeNs, 2> returned_ns_{};  ///< when texts came back with `command`, the newest first
};

/// What a drone's state texts and answers show of the drone itself, wherever it is. Core; one thread.
struct DroneWatches {
  TiltWatch tilt;
  BatteryWatch battery;
  HeatWatch heat;
  ClientWatch client;

  /// A state text that came at `now`.
  void on_state(TimeNs now, const TelloState& state, LinkPhase phase) noexcept;
};

}  // namespace ledgerline::link
