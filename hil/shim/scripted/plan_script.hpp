#pragma once
#include <array>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/msg/onboard.hpp"
#include "hil/proxy/switches.hpp"

namespace ledgerline::hil::shim {

/// What an agent says to link, and what goes wrong meanwhile: a TOML file (docs/shim.md). Times are since the script
/// began.
struct PlanScript {
  /// A plan, repeated until `until_ns`: flown ones 30 times a second, each good for 0.6 s; the others 10 times a
  /// second.
  struct Say {
    TimeNs at_ns = 0, until_ns = 0;
    DroneNumber drone = 0;  ///< 0: every one
    PlanAction action = PlanAction::fly;
    std::array<float, 3> velocity_mps{};  ///< in `map`
    float yaw_rate_radps = 0;
  };
  /// agent says nothing at all: no plan, no pose, no sign of life.
  struct Silence {
    TimeNs at_ns = 0, until_ns = 0;
  };
  int drones = 1;
  TimeNs end_ns = 0;
  std::vector<Say> says;
  std::vector<Silence> silences;
  std::vector<proxy::ScriptedFault> faults;
};

/// Errors name file, line and key.
Result<PlanScript> load_plan_script(const std::string& path);
Result<PlanScript> parse_plan_script(std::string_view toml, const std::string& file);

}  // namespace ledgerline::hil::shim
