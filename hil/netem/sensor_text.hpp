#pragma once
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::hil {

/// What a drone's state text ("...;tof:10;h:0;bat:100;...") says wrongly.
struct SensorFault {
  enum class Kind { stuck, garbage, bias, says, every } kind{};
  std::string field;  ///< of the state text: "h", "tof", "bat" ...; empty: all of it (stuck, garbage, every)
  double bias = 0;    ///< in the text's unit; says: the value
  double share = 1;   ///< of the texts, each by itself
  TimeNs period_ns = 0;
  std::size_t item = 0;  ///< which of the drone's faults it is, so that it is known again: see renew()
  std::string last{};    ///< stuck: what it said first
  TimeNs next_ns = 0;
};

/// "h stuck", "all garbage", "bat bias -95", "vgx says 5", "all every 700ms"; a share of the texts behind it: "yaw
/// stuck 30%".
Result<SensorFault> parse_sensor(std::string_view text);

/// Puts `faults` in the place of those before; one that was there already remembers what it said.
void renew(std::vector<SensorFault>& known, std::vector<SensorFault> faults);

/// Changes a state text as the faults say, which remember what they need. False: it is not said at all.
bool misreport(TimeNs now, std::vector<SensorFault>& faults, Random& random, std::string& text);

}  // namespace ledgerline::hil
