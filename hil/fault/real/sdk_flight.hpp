#pragma once
#include <cstdint>
#include <vector>

#include "hil/fault/real/real_run.hpp"
#include "hil/fault/real/real_script.hpp"

namespace ledgerline::hil {

/// All that an SDK client's flight cannot have of this script: there is no link, agent, ground or ledger in it, and the
/// proxy alone does faults to the drones.
std::vector<NotReal> not_by_sdk(const Script& script);
/// The same as an error, a line each.
Status check_sdk(const Script& script);

/// Flies a script of kind sdk in real time: ledgerline-sim, ledgerline hil proxy before it, and somebody's own SDK
/// client (options.own.program), which is checked against the truth and by how it ends.
///
///     a network of its own                another one
///     client, any Tello program -- veth -- proxy 192.168.10.k -- drone 10.77.0.(k+1)
///
/// The client binds whatever ports it likes, and finds drone k at 192.168.10.k: one that flies a single Tello needs no
/// change, since that is where a Tello's own network has it. The addresses are in TELLO_ADDRESSES, too, with commas
/// between. Needs root, if only of a user namespace, for the two networks. Errors: what check_sdk() says, and whatever
/// kept it from being flown. One thread, which starts the programs.
Result<RunResult> fly_by_sdk(const Script& script, std::uint64_t seed, const RealOptions& options);

}  // namespace ledgerline::hil
