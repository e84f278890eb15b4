#pragma once
#include <array>

#include "common/rt/clock.hpp"
#include "onboard/link/core/tello/tello_text.hpp"
#include "onboard/link/core/watch/motion_watch.hpp"

namespace ledgerline::link {

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
  /// 3 degrees beyond what wind and drag need: half is the noise of attitudes in whole degrees; double is a stick of
  /// 0.3 m/s. And 8 degrees, which no steady flight needs.
  static constexpr double lean_mps2 = 0.5, far_lean_mps2 = 1.4;
  /// Of its value two texts before: a drone that sees has got up speed by then, and half of the lean is gone.
  static constexpr double lasting_share = 0.75;
  /// Without a lean: 0.6 s. Half is an rc that was held up on its way; double is as late as the zeros.
  static constexpr int fade_texts = 6;
  static constexpr TimeNs zeros_for_ns = 1 * ns_per_s;  ///< half is a start from rest
  static constexpr double sees_again_mps = 0.15;        ///< more than the least it has reported since: two steps

  /// What moves the drone as link knows it, in one frame.
  struct Motion {
    MotionWatch::Expected expected;
    std::array<double, 2> sent_mps{};   ///< the newest stick
    std::array<double, 2> lean_mps2{};  ///< level part of its thrust, by its attitude
  };

  /// A state text in flight that came at `now`.
  void update(TimeNs now, const TelloState& state, const Motion& motion) noexcept;
  void reset() noexcept { *this = {}; }
  /// It is suspected to see nothing.
  bool blind() const noexcept { return since_ns_ != 0; }
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
