#pragma once
#include <cstdint>

namespace ledgerline::link {

/// Notices that a drone hovers above or below another, where the upper one's wash pushes the lower one down. Height
/// alone keeps two drones from touching, but nobody may stay so. One for each drone.
///
///   none ──stacked and still for max_hover_s──▶ leave ──beside the other──▶ stay_out ──stay_out_s, or alone──▶ none
///
/// Pure state: time comes in with each step; one thread.
class DownwashWatch {
 public:
  enum class Advice : std::uint8_t {
    none,
    leave,    ///< get beside the other
    stay_out  ///< do not go back: a goal that lies above another would lead there at once
  };
  /// A Tello's free jet of 4 m/s fades to a gust's 0.5 m/s some 1.5 m below it. Half leaves the lower drone in the jet;
  /// double forbids two layers under a ceiling of 3 m.
  static constexpr double height_m = 1.5;
  /// A path's corner above another takes half of it. With half a pass that is held up for a moment is taken for a stay,
  /// with double the lower drone sinks by its own height first.
  static constexpr double max_hover_s = 1;
  /// Two drones that move against each other faster than this pass. Corrections of a hovering drone are half of it.
  static constexpr double passing_mps = 0.2;
  /// Then a path that leads through may try again: nobody waits for ever. Half has a drone with its goal above another
  /// spend a third of the time there.
  static constexpr double stay_out_s = 10;

  /// `stacked`: another is above or below. `still`: neither moves against the other. `there`: it is still about.
  void step(double passed_s, bool stacked, bool still, bool there) noexcept {
    if (stacked && still) hovered_s_ += passed_s;
    if (!stacked) hovered_s_ = 0;
    if (advice_ == Advice::leave && !stacked) {
      advice_ = Advice::stay_out;
      out_s_ = 0;
    }
    if (advice_ == Advice::stay_out && ((out_s_ += passed_s) > stay_out_s || !there)) advice_ = Advice::none;
    if (hovered_s_ > max_hover_s) advice_ = Advice::leave;
  }
  Advice advice() const noexcept { return advice_; }

 private:
  Advice advice_ = Advice::none;
  double hovered_s_ = 0, out_s_ = 0;
};

}  // namespace ledgerline::link
