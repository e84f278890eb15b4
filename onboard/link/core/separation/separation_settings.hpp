#pragma once

namespace ledgerline::link {

/// How far drones of one host are kept apart, and by which model of them (separation.hpp).
struct SeparationSettings {
  /// Never nearer, centre to centre; in height as well, since a rotor's wash goes down. 0: drones are not kept apart.
  /// A Tello with its guards is 0.18 m wide. With half, a gust of 0.5 m/s for 0.3 s is more than what is left between
  /// two; with double three layers are all that fit under a ceiling of 3 m.
  double min_m = 0.5;
  /// On top, for what the model does not know: an rc's rounding and gap, noise of poses. With 0.15 two that fly beside
  /// each other drift together to 0.495 m in one of a hundred flights of eight; double keeps drones apart that could
  /// pass.
  double margin_m = 0.18;
  double response_s = 0.3;   ///< of the drone to a velocity, first order (docs/sources.md)
  double reaction_s = 0.05;  ///< RcSettings::changing_gap_ns, and what the radio takes
  /// Who has the right of way is yielded to for so long ahead: out of its way in height takes the other 1.7 s. Half
  /// makes the one with the right of way brake, double makes others yield to who will turn before.
  double lookahead_s = 2;
  /// Out of another's way in height. A landing's speed, the half of max_vertical: half keeps others waiting for 3 s,
  /// double climbs 0.4 m beyond where it is commanded to stop.
  double part_mps = 0.5;
  /// A landing that was asked for waits so long until nobody is below, then it is begun all the same. Half ends within
  /// detour_after_s and one way round, 6 s; double goes beyond the 20 s in which ground sees it land, or says that it
  /// did not.
  double landing_wait_s = 10;
};

}  // namespace ledgerline::link
