#pragma once
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// Something that the real processes cannot have.
struct NotReal {
  std::string key;  ///< of the script's file
  std::string what;
};
/// All that they cannot have of this script: faults of what is simulated inside (sensors, mocap, battery, the real clock
/// ...), settings that ./fly has not, rules that the traces do not tell.
std::vector<NotReal> not_real(const Script& script, const RealLedger& ledger);
/// The same as an error, a line each.
Status check_real(const Script& script, const RealLedger& ledger);

/// For ledgerline-fly, without --out and --json.
std::vector<std::string> fly_arguments(const Script& script, std::uint64_t seed, const RealLedger& ledger);

/// Of a fault that check_real() lets through, as it begins and as it ends. `active`: all that go on then, in the order
/// of the script; with the one that begins, without the one that ends. What another one keeps up is not ended.
RealActs acts_at_begin(const Fault& fault, const std::vector<Fault>& active, int drones, const RealLedger& ledger);
RealActs acts_at_end(const Fault& fault, const std::vector<Fault>& active, int drones, const RealLedger& ledger);

}  // namespace ledgerline::hil
