#pragma once
#include <Eigen/Core>
#include <optional>

#include "common/estimation/motion_filter.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// Holds a drone on board where its plan wants it: planned on the ground, held on board. What blows between the state
/// that a plan was made from and the moment when it takes effect, nobody on the ground can know; link sees it within a
/// pose's age. With p and v predicted for the moment when what is sent now takes effect (estimation::MotionFilter), the
/// law is ground's own (ground/core/controller.hpp),
///
///     u = (v_ref + lag a_ref + K (p_ref - p) + V (v_ref - v) - drift) / gain
///
/// and upward v_ref + K_z (p_ref - p). Of what was planned and signed it may differ by max_correction_mps along the
/// ground, and by as much upward; by less where the position itself is uncertain.
///
/// hold() is the same for a drone that is to stay where it is: at first it stops, then that place is kept.
///
/// Core: no I/O, no clock, no allocation; one thread.
class Tracker {
 public:
  explicit Tracker(const TrackSettings& settings) noexcept : settings_(settings), filter_(Response{}) {}

  /// Of the drone's pilot, in the frame that plans are made in.
  void on_pose(const Pose& pose) noexcept;
  /// In every step: what the drone was sent last, and whether it `moves` as it was (MotionWatch).
  void on_sent(TimeNs now, const Velocity& sent, bool moves) noexcept;
  void set_response(const Response& response) noexcept { filter_.set_response(response); }

  /// A drone that does not move as it is sent hears late, or does otherwise: corrections would make it worse, and hide
  /// it. It is corrected again when it has moved so for as long as MotionWatch takes to be sure: with half, link lets
  /// go and takes hold in turn.
  static constexpr TimeNs moves_for_ns = 4 * ns_per_s;
  bool may_correct(TimeNs now) const noexcept { return filter_.ready() && now - disobeyed_ns_ > moves_for_ns; }
  /// In place of `planned` (map). `reference`: for what is sent now.
  Velocity follow(TimeNs now, const Velocity& planned, const Reference& reference) noexcept;
  /// In place of zero; a place that was held before is held on.
  Velocity hold(TimeNs now) noexcept;
  /// It flies somewhere else, or not at all: the next hold() is of another place.
  void let_go() noexcept { hold_ = {}; }
  /// What is known of it is of before: its host slept.
  void reset() noexcept { *this = Tracker(settings_); }

 private:
  struct Hold {
    TimeNs since_ns = 0;  ///< 0: none
    std::optional<Eigen::Vector3d> place_m;
  };
  /// Position and velocity when what is sent now takes effect.
  const estimation::Motion& effect(TimeNs now) noexcept;
  Velocity correct(TimeNs now, const Velocity& planned, const Reference& reference) noexcept;

  TrackSettings settings_;
  estimation::MotionFilter filter_;
  double certainty_ = 1;  ///< of the newest pose: the share of a correction that is flown
  estimation::Motion effect_;
  TimeNs effect_of_ns_ = 0;  ///< when effect_ was computed
  TimeNs last_sent_ns_ = 0;
  TimeNs disobeyed_ns_ = -moves_for_ns;  ///< when it did not move so last
  Hold hold_;
};

}  // namespace ledgerline::link
