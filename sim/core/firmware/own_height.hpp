#pragma once
#include "sim/core/parameters.hpp"
#include "sim/core/world.hpp"

namespace ledgerline::sim {

/// The highest table's top below a position, or the floor's 0.
double floor_height_m(const Parameters& parameters, const Vector& position);

/// The height that the flight controller flies by, from its own sensors: what tof measures, so that it may
/// climb over a table (ControlParameters::follows_floor); where tof measures nothing, the barometer and its drift. One
/// thread.
class OwnHeight {
 public:
  explicit OwnHeight(const Parameters& parameters) : p_(parameters) {}
  /// Every millisecond; above where it took off, as far as it knows.
  double step(const Body& body, const Sensing& sensing);
  /// It takes off: here it knows how high it is.
  void set_out() { error_m_ = 0; }

 private:
  Parameters p_;
  double error_m_ = 0;
};

}  // namespace ledgerline::sim
