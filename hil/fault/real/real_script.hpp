#pragma once
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// All that the real processes cannot have of this script, a line each: faults of what is simulated inside (sensors,
/// mocap, battery, the real clock ...), settings that ./fly has not, rules that the traces do not tell.
Status check_real(const Script& script, const RealLedger& ledger);

/// For ledgerline-fly, without --out and --json.
std::vector<std::string> fly_arguments(const Script& script, std::uint64_t seed, const RealLedger& ledger);

/// Of a fault that check_real() lets through, as it begins and as it ends. `active`: all that go on then, in the order
/// of the script; with the one that begins, without the one that ends. What another one keeps up is not ended.
RealActs acts_at_begin(const Fault& fault, const std::vector<Fault>& active, int drones, const RealLedger& ledger);
RealActs acts_at_end(const Fault& fault, const std::vector<Fault>& active, int drones, const RealLedger& ledger);

}  // namespace ledgerline::hil
