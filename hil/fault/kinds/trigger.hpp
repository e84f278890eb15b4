#pragma once
#include <cstdint>
#include <string_view>

#include "common/base/result.hpp"
#include "hil/sitl/facts.hpp"

namespace ledgerline::hil {

/// A moment of a flight, as text: "5s" (of the run), "takeoff" (it leaves the ground), "flying", "path", "lap 2" (it
/// begins), "height 0.5", "landing", "landed"; each but the first with "+ 2s" behind it, if wanted. Of the fault's
/// drone; of the first one that gets there where the fault is no drone's.
struct Trigger {
  enum class Kind : std::uint8_t { time, takeoff, flying, path, lap, height, landing, landed };
  Kind kind = Kind::time;
  double value = 0;                                                           ///< the lap's number; the height [m]
  TimeNs after_ns = 0;                                                        ///< time: the moment itself
  bool of_a_path() const { return kind == Kind::path || kind == Kind::lap; }  ///< ground flies one
  bool reached(TimeNs now, const DroneFacts& drone) const;                    ///< without `after_ns`; not for time
};
Result<Trigger> parse_trigger(std::string_view text);

}  // namespace ledgerline::hil
