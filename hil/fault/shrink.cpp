#include "hil/fault/shrink.hpp"

#include <algorithm>
#include <string>

#include "hil/netem/distribution.hpp"

namespace ledgerline::hil {

Script shrink(Script script, const std::function<bool(const Script&)>& fails, int max_tries) {
  int left = max_tries;
  const auto better = [&](const Script& shorter) {
    if (left-- <= 0 || !fails(shorter)) return false;
    script = shorter;
    return true;
  };
  for (bool progress = true; progress && left > 0;) {
    progress = false;
    for (std::size_t i = script.faults.size(); i-- > 0;) {
      Script shorter = script;
      shorter.faults.erase(shorter.faults.begin() + static_cast<std::ptrdiff_t>(i));
      progress = better(shorter) || progress;
    }
    for (std::size_t i = 0; i < script.faults.size(); ++i) {
      Script shorter = script;
      shorter.faults[i].for_ns /= 2;
      if (shorter.faults[i].for_ns >= ns_per_ms) progress = better(shorter) || progress;
    }
    for (std::size_t i = 0; i < script.faults.size(); ++i) {
      const auto plus = script.faults[i].at.find('+');
      if (plus == std::string::npos) continue;
      Script shorter = script;
      Fault& fault = shorter.faults[i];
      fault.trigger.after_ns = fault.trigger.after_ns / 2 / ns_per_ms * ns_per_ms;
      const std::string head = fault.at.substr(0, plus);
      fault.at = fault.trigger.after_ns > 0 ? head + "+ " + time_text(fault.trigger.after_ns)
                                            : head.substr(0, head.find_last_not_of(' ') + 1);
      progress = better(shorter) || progress;
    }
    const bool needs_laps = std::any_of(script.faults.begin(), script.faults.end(), [&](const Fault& fault) {
      return fault.trigger.kind == Trigger::Kind::lap && fault.trigger.value > script.flight.laps / 2;
    });
    if (script.flight.laps > 1 && !needs_laps) {
      Script shorter = script;
      shorter.flight.laps /= 2;
      progress = better(shorter) || progress;
    }
    if (script.flight.drones > 1) {
      Script shorter = script;
      shorter.flight.drones = 1;
      const bool named = std::any_of(shorter.faults.begin(), shorter.faults.end(), [](const Fault& fault) {
        return !fault.drone.empty() && fault.drone != "tello1";
      });
      if (!named) progress = better(shorter) || progress;
    }
  }
  return script;
}

}  // namespace ledgerline::hil
