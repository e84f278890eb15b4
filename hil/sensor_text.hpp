#pragma once
#include <string>

#include "common/rt/clock.hpp"
#include "common/rt/random.hpp"

namespace ledgerline::hil {

/// What the drone's state text says wrongly.
struct SensorFault {
  enum class Kind { stuck, garbage, bias, every } kind{};
  std::string field;  ///< of the state text: "h", "tof", "bat" ...; empty: all of it (stuck, garbage, every)
  double bias = 0;    ///< in the text's unit
  TimeNs period_ns = 0;
  std::size_t item = 0;  ///< which of the drone's faults it is, so that it is known again: see set_sensor_faults()
  std::string last{};    ///< stuck: what it said first
  TimeNs next_ns = 0;
};

/// Whether a Tello's state text has such a field.
bool known_field(const std::string& field);

/// Changes a state text ("...;tof:10;h:0;bat:100;...") as the fault says; the fault remembers what it needs. False: it
/// is not said at all.
bool misreport(TimeNs now, SensorFault& fault, Random& random, std::string& text);

}  // namespace ledgerline::hil
