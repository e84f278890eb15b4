#pragma once
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"

/// The faults that people switch in a simulated flight, as the launcher and the clients have them. Pure; any thread.
namespace ledgerline::ground::service {

inline constexpr std::size_t max_fault_switches = 64;  ///< of sixteen drones there are 34

/// A fault of a simulated flight that people switch (docs/station.md).
struct FaultSwitch {
  std::string name;   ///< of a-z, 0-9, - and _: "silent-tello1"
  std::string drone;  ///< empty: of all
  std::string label;
  std::string words;  ///< what it does
  bool on = false;
};

/// All that there are, or why they are not known.
struct FaultList {
  std::vector<FaultSwitch> switches{};
  std::string why{};  ///< empty: they are known
};

/// What a client wants switched.
struct FaultRequest {
  std::string name;
  bool on = false;
  std::string by{};  ///< the operator's name; empty: nobody signs in
};

/// What the launcher answers to list, on and off:
/// {"faults":[{"name":...,"drone":...,"label":...,"words":...,"on":false}]}. Read strictly: the error says what is
/// wrong with it.
Result<std::vector<FaultSwitch>> faults_from(std::string_view text);

/// {"faults":[...]}
std::string faults_text(const FaultList& list);
/// The stream's: {"op":"faults","faults":[...],"why":""}
std::string faults_message(const FaultList& list);
/// The launcher's command: "on NAME".
std::string command_of(const FaultRequest& ask);
/// For the events: "Drone silent: switched on by alice".
std::string words_of(const FaultRequest& ask, const FaultSwitch& what);

}  // namespace ledgerline::ground::service
