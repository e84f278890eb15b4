#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/msg/onboard.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"
#include "hil/sitl/digester.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::hil::shim {

/// What came of a flight by script: all that the drones were sent, link's transitions, where drones ended. One thread.
class Record {
 public:
  explicit Record(TimeNs begin_ns) : begin_ns_(begin_ns) {}

  /// What link said to a drone, as it left link.
  void sent(TimeNs now, DroneNumber drone, std::string_view bytes);

  /// CSV of at most a million of them: seconds since the beginning, drone, text.
  Status write_datagrams(const std::string& path) const;
  /// Prints a JSON object in one line, and writes it where `path` is not empty.
  Status write_summary(TimeNs now, const std::vector<Transition>& transitions, const sim::Simulator& drones,
                       const SdkFaults::Counts& sdk, const std::string& path);

 private:
  static constexpr std::uint64_t max_lines = 1'000'000;

  TimeNs begin_ns_;
  std::uint64_t count_ = 0;
  std::string lines_ = "seconds,drone,text\n";
  Digester digester_;
};

}  // namespace ledgerline::hil::shim
