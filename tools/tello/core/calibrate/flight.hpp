#pragma once
#include <array>
#include <complex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tools/tello/core/calibrate/estimate.hpp"
#include "tools/tello/core/dialogue.hpp"

namespace ledgerline::tello {

struct CalibrationSettings {
  int repeat = 2;      ///< of the whole schedule, a minute each
  bool poses = false;  ///< a pose source is expected: without a fresh pose it does not take off, and lands
};

/// Flies one Tello through small steps of rc and records what came of them: one channel at a time, forwards and back,
/// at two headings a right angle apart, around the place where it took off. The drone's own words are its only senses
/// where there are no poses.
///
///     handshake -> (poses) -> takeoff -> hover, strokes, (back), hover, ... -> landing -> over
///                                 any of them: what is wrong, or end() -> landing
///
/// With poses it goes back to where it began between the strokes, by the way that rc was seen to lead: a Tello drifts.
///
/// Lands when battery < 30 %, tilt > 35 degrees, height outside of 0.25..2.5 m, further than 2 m from where it began
/// (since the last turn, where there are no poses), no state text or pose for 1 s, an action refused. A stroke ends
/// early that leads beyond 0.7 m (0.35 m up or down). Landing is repeated until the drone is down (Landing), for 60 s
/// at most: one that is not heard any more lands by itself 15 s after the last word. Core: no I/O, no clock; one
/// thread.
class CalibrationFlight {
 public:
  explicit CalibrationFlight(const CalibrationSettings& settings) : settings_(settings) {}

  /// What is to be sent now, in this order. To be asked at least each 10 ms.
  std::vector<std::string> pop_due(TimeNs now);
  void on_answer(std::string_view bytes);
  void on_state(TimeNs now, std::string_view bytes);
  void on_pose(const PoseSample& pose);
  /// Lands; the first reason counts.
  void end(const std::string& why);

  bool over() const { return phase_ == Phase::over; }
  /// Why there is nothing to estimate from; empty: all was flown.
  const std::string& failure() const { return failure_; }
  /// Landing was repeated without result: it may be in the air.
  bool aloft() const { return phase_ == Phase::over && took_off_ && !landing_.down(); }
  const Record& record() const { return record_; }
  /// For people: what it does now.
  std::string doing() const;

 private:
  enum class Phase { handshake, poses, takeoff, back, hover, stroke, landing, over };
  using Words = std::vector<std::string>;

  void handshake(TimeNs now, Words& words);
  void wait_for_pose(TimeNs now);
  void take_off(TimeNs now, Words& words);
  void fly(TimeNs now, Words& words);
  void land(TimeNs now, Words& words);
  void begin(Phase phase, TimeNs now);
  void begin_block(TimeNs now);
  void next_stroke(TimeNs now);
  /// rc that leads back to where it began; none where it is near enough, or not seen, or its way not known.
  link::Rc rc_home() const;
  bool stroke_ends(TimeNs now) const;
  void set_rc(TimeNs now, int channel, int value);
  Status check(TimeNs now) const;
  double away_m() const;
  bool aloft_now() const { return height_of(senses_.state) >= 0.4F; }

  /// What is known of the drone.
  struct Senses {
    link::TelloState state;
    TimeNs state_ns = 0;
    std::optional<PoseSample> pose, home;
    std::array<double, 3> way_m{};  ///< by its own velocities, from where it took off or turned
    double turned_deg = 0;
  };
  /// How far it is in the schedule.
  struct Progress {
    std::size_t block = 0, stroke = 0;
    std::optional<PoseSample> stroke_from;
    double last_away_m = 0;
    bool outwards = false;
  };

  CalibrationSettings settings_;
  Phase phase_ = Phase::handshake;
  Landing landing_;
  Record record_;
  std::string failure_, refusal_;
  bool answered_ = false, took_off_ = false;
  int tries_ = 0;
  TimeNs since_ns_ = 0, said_ns_ = 0, now_ns_ = 0, takeoff_ns_ = 0;
  Senses senses_;
  Progress progress_;
  /// Sums of where rc right and forward led, turned by the pose's own yaw.
  std::array<std::complex<double>, 2> response_m_{};
  link::Rc rc_{};
};

}  // namespace ledgerline::tello
