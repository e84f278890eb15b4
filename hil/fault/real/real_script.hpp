#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hil/fault/kinds/fault.hpp"
#include "hil/fault/own_code.hpp"
#include "hil/fault/script.hpp"

// What of a script the real processes can have, and how they learn of it.

namespace ledgerline::hil {

/// Something that the real processes cannot have.
struct NotReal {
  std::string key;  ///< of the script's file
  std::string what;
};
/// All that they cannot have of this script: faults of what is simulated inside (sensors, mocap, battery, the real
/// clock ...), settings that ./fly has not, rules that the traces do not tell.
std::vector<NotReal> not_real(const Script& script, const RealStack& stack);
/// The same as an error, a line each. `own`: who flies what ground does not.
Status check_real(const Script& script, const RealStack& stack, const OwnCode& own = {});

/// For ledgerline fly, without --out and --json, and without the waypoints of a course of one's own.
std::vector<std::string> fly_arguments(const Script& script, std::uint64_t seed, const RealStack& stack);

/// Of a fault that check_real() lets through, as it begins and as it ends. `active`: all that go on then, in the order
/// of the script; with the one that begins, without the one that ends. What another active fault still requires stays
/// in force.
RealActs acts_at_begin(const Fault& fault, const std::vector<Fault>& active, int drones, const RealStack& stack);
RealActs acts_at_end(const Fault& fault, const std::vector<Fault>& active, int drones, const RealStack& stack);

/// All that is wrong with a script without flying it, each as "FILE:LINE: key: what". `real`: for a flight with the
/// real processes on this ledger: then also whatever they cannot have. A manual or SDK flight without a simulated pilot
/// is always checked as one with the real processes.
Result<Script> check_script(std::string_view toml, const std::string& file, const std::optional<RealStack>& real = {});

}  // namespace ledgerline::hil
