#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <string_view>

#include "onboard/link/core/settings.hpp"

/// The Tello SDK's texts: state packets, answers and the `rc` command. Any bytes may come in; nothing is allocated.
namespace ledgerline::link {

/// What link uses of a state packet. Fields that a packet lacks keep the value they had.
struct TelloState {
  float height_m = 0;  ///< `h`, above take-off, in steps of 0.1 m
  float tof_m = 0;     ///< 0.1 on the ground; 65.53 when it sees nothing
  float battery = 0;   ///< 0..1
  /// Roll (right), pitch (up) and yaw (clockwise, since power on); positive as in the brackets.
  std::array<float, 3> attitude_deg{};
  std::array<float, 3> acceleration_mg{};  ///< forward, right, down, with gravity: about 0, 0, -1000 at rest
  /// vgx, vgy, vgz as they are reported: in which frame is for the reader to know.
  std::array<float, 3> velocity_dmps{};
  bool has_velocity = false;  ///< all three are in the newest packet
  float barometer_m = 0;      ///< from an arbitrary zero
  bool has_barometer = false;
  float temperature_c = 0;  ///< the hotter one of templ and temph; 0: not reported
  bool has_motor_time = false;
  int motor_s = 0;  ///< `time`: with running motors since power on, so that it falls when the drone was switched off
  /// The mission pad below: -1 none is seen, -2 it does not look for them, or the firmware knows none.
  int pad = -2;
  std::array<float, 3> on_pad_m{};  ///< the drone in the pad's frame
  float on_pad_yaw_deg = 0;         ///< the third of mpry
};

/// False, and `state` untouched, unless battery, h and tof are there, plausible, with the semicolon that ends each.
bool parse_state(std::string_view bytes, TelloState& state) noexcept;

// A Tello's axes are forward, right, down; REP 103's forward, left, up. Angles in radians, SI units.
inline constexpr std::array<float, 3> forward_left_up{1, -1, -1};
/// Beyond, tof sees nothing: it says 65.53, and a Tello's flow ends before.
inline constexpr float tof_sees_m = 6;
inline constexpr float rad_per_deg = std::numbers::pi_v<float> / 180;

/// Roll, pitch, yaw.
inline std::array<float, 3> attitude_rad(const TelloState& state) noexcept {
  std::array<float, 3> out{};
  for (std::size_t i = 0; i < 3; ++i) out[i] = forward_left_up[i] * state.attitude_deg[i] * rad_per_deg;
  return out;
}

/// The level part of a hovering drone's thrust by its lean, forward and left: what it gathers speed with in still air.
inline std::array<double, 2> lean_mps2(const TelloState& state) noexcept {
  constexpr double gravity_mps2 = 9.80665;
  const auto attitude = attitude_rad(state);
  return {gravity_mps2 * std::tan(static_cast<double>(attitude[1])),
          -gravity_mps2 * std::tan(static_cast<double>(attitude[0]))};
}

inline std::array<float, 3> acceleration_mps2(const TelloState& state) noexcept {
  constexpr float mps2_per_mg = 9.80665F / 1000;
  std::array<float, 3> out{};
  for (std::size_t i = 0; i < 3; ++i) out[i] = forward_left_up[i] * state.acceleration_mg[i] * mps2_per_mg;
  return out;
}

/// Without the CR, LF, blanks and zeros that firmwares end an answer with.
std::string_view without_line_end(std::string_view bytes) noexcept;

enum class Answer : std::uint8_t { ok, refused, unknown };
/// `ok` alone (any case, CR LF stripped) is ok; what begins with error, out of range or unknown command is a refusal;
/// anything else is unknown, and does not count as an answer.
Answer parse_answer(std::string_view bytes) noexcept;

/// The first `capacity` bytes of a text, in place.
template <std::size_t capacity>
struct FixedText {
  FixedText() noexcept = default;
  explicit FixedText(std::string_view text) noexcept
      : size(static_cast<std::uint8_t>(std::min(text.size(), capacity))) {
    std::copy_n(text.begin(), size, bytes.begin());
  }
  std::string_view view() const noexcept { return {bytes.data(), size}; }

  std::array<char, capacity> bytes{};
  std::uint8_t size = 0;
};
/// Of what a drone said, for people; any bytes, so that who shows it makes it printable.
using Quote = FixedText<120>;
/// A command as it goes to the drone.
using CommandText = FixedText<32>;

/// rc a b c d: right, forward, up, clockwise; -100..100 each.
using Rc = std::array<int, 4>;
CommandText rc_text(const Rc& rc) noexcept;

/// A velocity, of the map frame unless said otherwise, and a yaw rate, counter-clockwise.
struct Velocity {
  std::array<float, 3> mps{};
  float yaw_radps = 0;
};

/// The rc command for a velocity, and the velocity that it really means once every channel is within its range.
struct BodyCommand {
  Rc rc{};
  Velocity sent;  ///< map frame
};

/// From the map frame (ENU) into the drone's (REP 103: x forward, y left, z up) by its yaw, then to rc's channels. A
/// velocity beyond rc's range is made shorter, its direction kept.
BodyCommand to_body(const RcSettings& settings, const Velocity& velocity, double yaw_rad) noexcept;

/// From the drone's frame into the map's.
Velocity to_map(const Velocity& body, double yaw_rad) noexcept;

}  // namespace ledgerline::link
