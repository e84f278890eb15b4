#pragma once
#include <cstdint>
#include <string_view>

#include "common/rt/fixed_vector.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// What a drone said, and when; 0: never.
struct DroneText {
  TimeNs at_ns = 0;
  Quote text;
};

/// What a drone's state texts report of it, and whether that is of now. A text of another moment or of another drone is
/// refused, by `time`, which grows as time does while the motors run. Core: no I/O, no allocation; one thread.
class ReportedState {
 public:
  explicit ReportedState(const SessionSettings& settings) noexcept
      : airborne_m_(settings.airborne_m), grounded_m_(settings.grounded_m) {}

  /// False where it is no state text, or is refused. `connected`: else any `time` may come.
  bool on_text(TimeNs now, std::string_view bytes, bool connected) noexcept;
  /// The host was suspended for so long while its clock stood still.
  void grow_older(TimeNs slept_ns) noexcept;

  /// Its battery is as low as battery_says_so of the newest battery_texts texts say, or the first one alone.
  const TelloState& newest() const noexcept { return newest_; }
  /// When the newest text came; 0: none yet.
  TimeNs at_ns() const noexcept { return at_ns_; }
  /// Young enough to decide about take-off and landing, and what it shows then.
  bool is_fresh(TimeNs now) const noexcept;
  bool is_airborne(TimeNs now) const noexcept;
  bool is_grounded(TimeNs now) const noexcept;
  /// Datagrams that were no state text.
  std::uint32_t unreadable() const noexcept { return unreadable_; }
  /// One of them, when that is all that comes: the newest a minute.
  const DroneText& unreadable_text() const noexcept { return unreadable_text_; }

 private:
  void on_unreadable(TimeNs now, std::string_view bytes) noexcept;
  void update_battery(float reported) noexcept;
  /// False where `time` shows that the text is of another moment, or of another drone.
  bool accept_motor_time(TimeNs now, const TelloState& reported, bool connected) noexcept;

  float airborne_m_, grounded_m_;
  TelloState newest_;
  FixedVector<float, SessionSettings::battery_texts> batteries_;  ///< as reported, oldest first
  TimeNs at_ns_ = 0;
  int motor_s_ = 0;              ///< `time` of the newest text ...
  double motor_lead_s_ = -1e18;  ///< ... and by how much one was ahead of the clock at most
  int refused_texts_ = 0;        ///< in a row that are not of now
  double refused_lead_s_ = 0;    ///< of the first of them
  std::uint32_t unreadable_ = 0;
  int unreadable_in_a_row_ = 0;
  DroneText unreadable_text_;
};

}  // namespace ledgerline::link
