#pragma once
#include <array>
#include <string_view>

// Verbs of `ledgerline`. A new one: its main here, a row in the table, its name and file in an ll_verbs() of
// tools/CMakeLists.txt.
namespace ledgerline::command {

/// As main(): `argv[0]` is the verb.
using Main = int(int argc, char** argv);

Main alarms, audit, bench, configuration, contract, control, dds_security, demo, doctor, drones, fabric, fault, flights,
    fly, hil, identity, init, ledger, local, missions, receipt, status, tello, timing, topics;

struct VerbRow {
  std::string_view group;    ///< its heading in `ledgerline --help`
  std::string_view name;     ///< as it is typed
  std::string_view program;  ///< in libexec/ledgerline; empty: a service, bin/ledgerline-NAME
  std::string_view about;    ///< a line
};

inline constexpr std::array<VerbRow, 35> verbs{{
    {"Fly", "fly", "ledgerline-fly", "fly simulated drones, or a deployment's own, and report how it went"},
    {"Fly", "demo", "ledgerline-fly", "three drones, a page and two operators, with what to try"},
    {"Fly", "tello", "ledgerline-tools", "find, check, calibrate and set up a real Tello"},
    {"Ground station", "drones", "ledgerline-station", "list, take, fly and stop drones at a running ground"},
    {"Ground station", "missions", "ledgerline-station", "add, approve, start and watch missions"},
    {"Ground station", "flights", "ledgerline-station", "what is flown now, by whom"},
    {"Ground station", "alarms", "ledgerline-station", "what went wrong so far, over or not"},
    {"Ground station", "control", "ledgerline-control", "leases, grants and stops, straight to the ledger"},
    {"Ground station", "topics", "ledgerline-station", "what a bridge carries, topic by topic"},
    {"Ledger", "fabric", "ledgerline-ledger", "run a Fabric network on this host"},
    {"Ledger", "contract", "ledgerline-ledger", "package the contract, and install it on your own network"},
    {"Ledger", "identity", "ledgerline-ledger", "enroll, renew and revoke certificates"},
    {"Ledger", "ledger", "ledgerline-ledger", "what the ledger holds: a value, its history, a transaction"},
    {"Ledger", "audit", "ledgerline-ledger", "check a ledger from its first block, and say what was flown"},
    {"Ledger", "receipt", "ledgerline-ledger", "a proof of one transaction, checked without the ledger"},
    {"Hosts", "init", "ledgerline-ledger", "write the configs of a host"},
    {"Hosts", "doctor", "ledgerline-ledger", "what keeps this host from flying, and the cure"},
    {"Hosts", "status", "ledgerline-ledger", "programs, ledgers and drones of this host"},
    {"Hosts", "dds-security", "ledgerline-ledger", "governance and permissions for ROS 2's SROS2"},
    {"Hosts", "configuration", "ledgerline-ledger", "every key of every config"},
    {"Faults", "fault", "ledgerline-fault", "fly scripts of faults in simulated time, and judge them"},
    {"Faults", "hil", "ledgerline-fault", "impair real connections: the proxy, and the shim in place of UDP"},
    {"Measuring", "timing", "ledgerline-tools", "where the milliseconds of a flight went"},
    {"Measuring", "bench", "ledgerline-tools", "benchmarks against other designs"},
    {"Measuring", "experiment", "ledgerline-experiment", "the published curves, flown again"},
    {"Measuring", "local", "ledgerline-tools", "the same controller beside the drone, without a ledger"},
    {"Services", "link", "", "flies the drones of its host: the Tello SDK, limits, failsafe"},
    {"Services", "agent", "", "brings states to the ledger, and its commands to link"},
    {"Services", "roudi", "", "the shared memory between those two"},
    {"Services", "ground", "", "plans and steers, serves the page"},
    {"Services", "bridge", "", "carries any ROS 2 topic over the ledger"},
    {"Services", "node", "", "a ledger in one process, without Fabric"},
    {"Services", "chaincode", "", "the contract, for Fabric's peers"},
    {"Services", "endorser", "", "an organisation's own endorser beside its peer"},
    {"Services", "sim", "", "simulated drones, and motion capture"},
}};

}  // namespace ledgerline::command
