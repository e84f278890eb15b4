#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "hil/fault/kinds/fault.hpp"
#include "hil/fault/own_code.hpp"
#include "hil/fault/run/run.hpp"
#include "hil/fault/script.hpp"

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

struct RealOptions {
  std::string programs;   ///< directory of the programs
  std::string directory;  ///< of this flight, made here: its run, metrics and logs
  RealStack stack;
  OwnCode own{};  ///< a plug-in, or the program that flies a manual flight or one by the SDK
};

/// Makes a flight's folder, in which none of these may be there already: they are of another flight.
Status make_flight_folder(const std::string& folder, const std::vector<std::string>& must_not_be_there);

/// Flies a script with the real processes, `ledgerline fly --proxy` (of an SDK client: fly_by_sdk), in real time,
/// and checks it by their traces. A moment comes up to a second late: that is how long traces are
/// buffered. It promises a verdict, not bytes; digest and counts of the ledger are not in the result. Errors: what
/// check_real() says, and whatever kept it from being flown or from doing what the script says. One at a time on a
/// machine; the calling thread starts the programs.
Result<RunResult> run_really(const Script& script, std::uint64_t seed, const RealOptions& options);

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
