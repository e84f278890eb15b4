#pragma once
#include <array>
#include <cstddef>

#include "common/msg/onboard.hpp"
#include "common/rt/clock.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// Whether a drone moves as it is commanded: the commands go through the drone's response (first order), what is seen
/// of it through the same filter, and the two must not differ for long. So a drone that hears another drone's rc, or
/// whose poses are another drone's or turned against it, is found, whatever the cause. A heading that is wrong from the
/// start is found where poses come from elsewhere alone: a drone's own odometry turns with it.
///
/// One that is only blown leans against the wind, by what it lacks: (commanded - flown) / response. So how it leans
/// over seconds says how far the wind may drift it, and that much counts for nothing, nor where it holds its position
/// against it. One that disobeys does not lean against how it moves. Horizontal, map frame. Core; one thread.
class MotionWatch {
 public:
  static constexpr double response_s = 0.3;  ///< as the simulator's drone, assumed (docs/sources.md)
  /// Three times what gusts do (0.1 m/s). Double would miss the usual 0.5 m/s; half would land for a windy day.
  static constexpr double limit_mps = 0.3;
  /// Of the commanded velocity: drag makes a fast drone slower than commanded.
  static constexpr double limit_share = 0.6;
  /// Excess speed of a blind drone, by its newest pose, unfiltered: filtered, or with double, it is noticed at 2.5 m/s
  /// where the stick says 1 m/s. Half would land flights in the dark that ground can still steer by motion capture.
  static constexpr double outrun_mps = 0.8;
  /// A push from outside is over by then, and so is a jam of 3 s on the way to the drone. A turned frame has led
  /// it two metres away at 0.5 m/s: half would land for a jam of datagrams, double doubles the two metres.
  static constexpr TimeNs differs_for_ns = 4 * ns_per_s;
  /// Wind of 4 m/s drifts a drone by its drag (0.4 to 0.54 a second) times its response: 0.5 to 0.65 m/s. Half lands
  /// for 2 m/s of wind; with double one that is carried off at walking pace would be blown.
  static constexpr double max_drift_mps = 0.7;
  /// Of the lean: shorter than differs_for_ns, so that wind which begins is known in time. Half takes a start, or flow
  /// that is lost, for wind; double is too late. At rest there is nothing to confuse it with.
  static constexpr double learns_s = 3, learns_at_rest_s = 1;

  /// How it should move: by its commands alone, and what the wind may add.
  struct Expected {
    std::array<double, 2> response_mps{}, drift_mps{};
  };

  /// Time passed since the last call: `sent_mps` all the while.
  void on_sent(double seconds, const std::array<float, 3>& sent_mps) noexcept;
  /// The level part of its thrust, by its attitude: until the next one.
  void set_lean(const std::array<double, 2>& lean_mps2) noexcept { lean_mps2_ = lean_mps2; }
  /// A new pose came: its velocity.
  void on_pose(TimeNs now, const std::array<double, 3>& velocity_mps) noexcept;
  /// It does not fly, or nothing is known.
  void reset() noexcept { *this = {}; }
  /// How fast it should move by now, by its commands alone.
  double expected_mps() const noexcept;
  Expected expected() const noexcept { return {expected_mps_, drift_mps_}; }
  /// Since when it has been faster than it should be by outrun_mps, wind left out; 0: it is not. A corner that is flown
  /// late looks the same: only with another sign beside it does it say anything.
  TimeNs outruns_since_ns() const noexcept { return outruns_since_ns_; }
  /// Nobody corrects a drone that may disobey. Half is a corner at 1 m/s; with double one that hears seconds late is
  /// corrected the wrong way for longer.
  static constexpr TimeNs suspected_for_ns = ns_per_s;
  bool is_suspected() const noexcept { return since_ns_ != 0 && seen_ns_ - since_ns_ >= suspected_for_ns; }
  bool differs() const noexcept { return since_ns_ != 0 && seen_ns_ - since_ns_ >= differs_for_ns; }

 private:
  void learn_drift(double seconds) noexcept;

  std::array<double, 2> expected_mps_{}, smooth_mps_{};
  std::array<double, 2> lean_mps2_{}, drift_mps_{};
  TimeNs seen_ns_ = 0, since_ns_ = 0, outruns_since_ns_ = 0;
};

/// Whether a drone's own flow still sees anything. In the dark, or over a floor that shows nothing, a Tello's velocity
/// fades to zero or stays there, and nothing else in its text says so. Its flight controller then leans the drone
/// towards a velocity that it never measures, so it runs away for as long as a stick is out. Signs, each by itself:
///
///     fades    it reports less than fade_share of what it should do: at once where it leans as well, else for
///              fade_texts
///     leans    towards where it should go, more than it did over the last seconds, and the lean does not decay (three
///              texts) under a stick that stands still: where it reports nothing, or less than it should while it leans
///              by far_lean_mps2
///     zeros    nothing but zeros for zeros_for_ns while it should move
///
/// It stays suspected until its velocity does what a fading one cannot: grow. A drone that is to hover looks the same
/// with and without sight. Frames do not matter: speeds are compared, and the lean is given in the commands' frame.
/// Core; one thread.
class FlowWatch {
 public:
  /// Reported of what it should do: a Tello's scale may be 30 % short, and it reports whole dm/s, perhaps cut off.
  static constexpr double fade_share = 0.6, rounding_mps = 0.05;
  /// It should move so fast at least: below, a slow flight to one side is all rounding. Of zeros the lower one.
  static constexpr double fading_mps = 0.25, moving_mps = 0.15;
  /// 3 degrees beyond wind and drag: half is an attitude's rounding, double a stick of 0.3 m/s. 8: no steady flight.
  static constexpr double lean_mps2 = 0.5, far_lean_mps2 = 1.4;
  /// Of its value two texts before: a drone that sees has got up speed by then, and half of the lean is gone.
  static constexpr double lasting_share = 0.75;
  /// Without a lean: 0.6 s. Half is an rc that was held up on its way; double is as late as the zeros.
  static constexpr int fade_texts = 6;
  static constexpr TimeNs zeros_for_ns = 1 * ns_per_s;  ///< half is a start from rest
  static constexpr double sees_again_mps = 0.15;        ///< more than the least it has reported since: two steps

  /// What moves the drone as link knows it, in one frame.
  struct Inputs {
    MotionWatch::Expected expected;
    std::array<double, 2> sent_mps{};   ///< the newest stick
    std::array<double, 2> lean_mps2{};  ///< level part of its thrust, by its attitude
  };

  /// A state text in flight that came at `now`.
  void update(TimeNs now, const TelloState& state, const Inputs& inputs) noexcept;
  void reset() noexcept { *this = {}; }
  /// It is suspected to see nothing.
  bool is_dark() const noexcept { return since_ns_ != 0; }
  TimeNs since_ns() const noexcept { return since_ns_; }  ///< 0: it sees, as far as is known

 private:
  struct Text {
    double should_mps = 0, lean_mps2 = 0;
    std::array<double, 2> sent_mps{};
  };
  static constexpr std::size_t kept = 4;  ///< 0.3 s: as late as a Tello may say how fast it is

  bool lasting_lean() const noexcept;

  std::array<Text, kept> texts_{};  ///< the newest first
  std::size_t count_ = 0;
  TimeNs text_ns_ = 0;
  int faded_ = 0;         ///< texts in a row
  TimeNs zeros_ns_ = 0;   ///< for so long it has reported zeros where it should move
  TimeNs since_ns_ = 0;   ///< of the suspicion
  double least_mps_ = 0;  ///< that it has reported since
};

}  // namespace ledgerline::link
