#include "hil/fault/real/real_script.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <csignal>

#include "hil/lines/text_parse.hpp"
#include "hil/virtual/world_setup.hpp"

namespace ledgerline::hil {
namespace {

using What = Fault::What;

constexpr int fabric_orderers = 3;
constexpr double least_side_m = 0.5, max_side_m = 15;  // of tools/launcher/options.cpp
constexpr TimeNs max_death = ns_per_s;                 // the launcher starts again what died, within half a second

std::string name_of(Process process) {
  return process == Process::agent ? "agent" : process == Process::link ? "link" : "ground";
}

/// Why a fault cannot be; empty: it can.
std::string reason_against(const Fault& fault, const RealLedger& ledger) {
  switch (fault.what) {
    case What::line:
      if (fault.lines == std::vector{LineAt::plans}) return "plans go from agent to link in shared memory";
      return std::find(fault.lines.begin(), fault.lines.end(), LineAt::mocap) == fault.lines.end()
                 ? ""
                 : "mocap goes past the proxy, by DDS";
    case What::mocap_frozen:
    case What::mocap_offset:
    case What::mocap_noise:
    case What::mocap_every:
    case What::reboot:
    case What::battery:
    case What::drain:
    case What::propeller:
    case What::kick:
    case What::wind:
      return "it is inside of the simulation: virtual time alone has it";
    case What::ledger_stale:
      return "a peer that is behind its channel is not built: virtual time alone has it";
    case What::ledger_lie:
    case What::relay:
    case What::slip:
      return "no real peer or operator does this: virtual time alone has it";
    case What::ledger_restart:
      return ledger.fabric ? "name the part: `peer 1 kill`, `orderer 1 kill`, `chaincode 1 kill`"
                           : "the embedded node's end is the flight's end: use `ledger stall`, or fly on Fabric";
    case What::clock_jump:
      return "the machine's clock is not this flight's alone: virtual time alone has it";
    case What::kill:
      if (fault.ends[0] == Process::ground) return "ground's end is the flight's end: use `ground stop`";
      return fault.for_ns == 0 || fault.for_ns > max_death
                 ? "the launcher starts it again at once: `for` must be at most 1 s"
                 : "";
    case What::end:
      return "link's end is the flight's end: virtual time alone has it";
    case What::stop_drone:
      if (fault.stopper != Stopper::operating)
        return "nobody but the operator is enrolled there: virtual time alone has it";
      return fault.stop_word == StopWord::cut ? "a real flight's motors are not cut: virtual time alone has it" : "";
    case What::fill_disk:
      return ledger.fabric ? "Fabric's parts end on a full disk: fly on the embedded node" : "";
    case What::kill_part:
      return ledger.fabric ? "" : "it is a part of Fabric: fly on it with --ledger fabric";
    default:
      return "";
  }
}

/// Why a rule cannot be judged.
std::string reason_against(const Rule& rule) {
  switch (rule.kind) {
    case Rule::Kind::hold_after_plan:
      return "the traces do not tell a plan's end";
    case Rule::Kind::sent:
      return "the traces do not tell it";
    case Rule::Kind::transactions:
      return "the traces do not tell how many there were";
    default:
      return "";
  }
}

std::vector<std::string> servers_of(Process process, const RealLedger& ledger) {
  std::vector<std::string> names{name_of(process)};
  for (int k = 1; ledger.fabric && k <= fabric_orderers; ++k)
    names.push_back(fmt::format("{}-orderer{}", name_of(process), k));
  return names;
}

std::string way_of(LineAt line) { return line == LineAt::to ? "to" : line == LineAt::answers ? "answers" : "state"; }

template <typename Values, typename Value>
bool has(const Values& values, const Value& value) {
  return std::find(values.begin(), values.end(), value) != values.end();
}

std::string all_of_it(const Impairment& impairment) {
  return impairment.any() ? "clear, " + text_of(impairment) : "clear";
}

/// The directions that a fault is about, each with all that lies upon it now: of one kind the later one in the script.
void set_lines(const Fault& changed, const std::vector<Fault>& active, int drones, RealActs& acts) {
  for (int k = 1; k <= drones; ++k) {
    const std::string drone = drone_name(k);
    const auto its = [&](const Fault& fault) { return fault.drone.empty() || fault.drone == drone; };
    if (!its(changed)) continue;
    for (const LineAt line : changed.lines) {
      Impairment all;
      for (const Fault& fault : active) {
        if (fault.what == What::line && its(fault) && has(fault.lines, line)) overlay(fault.impairment, all);
      }
      acts.proxy.push_back(fmt::format("drone {} {} {}", drone, way_of(line), all_of_it(all)));
    }
  }
}

/// The same of connections to the ledger. A cut: nothing comes up again until it is over.
void set_servers(const Fault& changed, const std::vector<Fault>& active, const RealLedger& ledger, RealActs& acts) {
  for (const Process process : changed.ends) {
    for (const bool to : {true, false}) {
      if (changed.what != What::ledger_cut && !(to ? changed.to : changed.from)) continue;
      Impairment all;
      for (const Fault& fault : active) {
        if (!has(fault.ends, process)) continue;
        const bool its_way = to ? fault.to : fault.from;
        if (fault.what == What::ledger_delay && its_way) all.delay = fault.delay;
        if (fault.what == What::ledger_hold && its_way) all.stall = true;
        if (fault.what == What::ledger_cut) all.partition = true;
      }
      for (const std::string& server : servers_of(process, ledger))
        acts.proxy.push_back(fmt::format("server {} {} {}", server, to ? "to" : "from", all_of_it(all)));
    }
  }
}

RealActs set_proxy(const Fault& changed, const std::vector<Fault>& active, int drones, const RealLedger& ledger) {
  RealActs acts;
  if (changed.what == What::line) set_lines(changed, active, drones, acts);
  if (changed.what == What::ledger_delay || changed.what == What::ledger_hold || changed.what == What::ledger_cut)
    set_servers(changed, active, ledger, acts);
  return acts;
}

std::string sensor_text(const Fault& fault) { return fmt::format("{}", fmt::join(words_of(fault.text), " ")); }

void stop_programs(const Fault& fault, const RealLedger& ledger, int signal, RealActs& acts) {
  if (fault.what == What::ledger_stall && ledger.fabric) {
    for (int k = 1; k <= fabric_orderers; ++k) acts.parts.emplace_back(fmt::format("orderer{}", k), signal);
  } else if (fault.what == What::ledger_stall) {
    acts.programs.emplace_back("ledgerline-node", signal);
  } else {
    acts.programs.emplace_back("ledgerline-" + name_of(fault.ends[0]), signal);
  }
}

}  // namespace

Status check_real(const Script& script, const RealLedger& ledger) {
  std::vector<std::string> reasons;
  const WorldConfig usual, &flight = script.flight;
  if (flight.side_m < least_side_m || flight.side_m > max_side_m)
    reasons.push_back(fmt::format("flight.side_m: ./fly flies paths of {} to {} m a side", least_side_m, max_side_m));
  if (flight.battery != usual.battery) reasons.push_back("flight.battery: ./fly flies with full batteries");
  if (!flight.keeps_rc || !flight.command_counts)
    reasons.push_back("flight.keeps_rc, flight.command_counts: ./fly flies the usual Tello");
  if (flight.room_m != usual.room_m) reasons.push_back("flight.room_m: ./fly flies with the usual fence");
  for (const Fault& fault : script.faults) {
    if (const auto why = reason_against(fault, ledger); !why.empty())
      reasons.push_back(fmt::format("\"{}\": {}", fault.text, why));
  }
  for (const Rule& rule : script.must) {
    if (const auto why = reason_against(rule); !why.empty())
      reasons.push_back(fmt::format("\"{}\": {}", rule.text, why));
  }
  if (reasons.empty()) return done;
  return Error{
      fmt::format("{} cannot be flown with the real processes:\n  {}", script.name, fmt::join(reasons, "\n  "))};
}

std::vector<std::string> fly_arguments(const Script& script, std::uint64_t seed, const RealLedger& ledger) {
  const WorldConfig& flight = script.flight;
  std::vector<std::string> arguments{"--proxy",
                                     "--drones",
                                     std::to_string(flight.drones),
                                     "--shape",
                                     ground::name_of(flight.shape),
                                     "--side",
                                     fmt::format("{:g}", flight.side_m),
                                     "--predict",
                                     flight.predict ? "on" : "off",
                                     "--max-age",
                                     fmt::format("{}ms", flight.max_age_ns / ns_per_ms),
                                     "--speed",
                                     fmt::format("{:g}", flight.speed_mps),
                                     "--rate",
                                     fmt::format("{:g}", flight.rate_hz),
                                     "--laps",
                                     std::to_string(flight.laps),
                                     "--batch-count",
                                     std::to_string(flight.batch_count),
                                     "--batch-timeout",
                                     fmt::format("{}ms", flight.batch_timeout_ns / ns_per_ms),
                                     "--seed",
                                     std::to_string(seed)};
  if (ledger.fabric)
    arguments.insert(arguments.end(), {"--ledger", "fabric", "--orderers", std::to_string(fabric_orderers)});
  return arguments;
}

RealActs acts_at_begin(const Fault& fault, const std::vector<Fault>& active, int drones, const RealLedger& ledger) {
  RealActs acts = set_proxy(fault, active, drones, ledger);
  switch (fault.what) {
    case What::ledger_cut:
      for (const Process process : fault.ends) {
        for (const std::string& server : servers_of(process, ledger)) acts.proxy.push_back("server " + server + " cut");
      }
      break;
    case What::sensor:
      acts.proxy.push_back(sensor_text(fault));
      break;
    case What::ledger_stall:
    case What::stop:
      stop_programs(fault, ledger, SIGSTOP, acts);
      break;
    case What::kill:
      stop_programs(fault, ledger, SIGKILL, acts);
      break;
    case What::kill_roudi:
      acts.programs.emplace_back("ledgerline-roudi", SIGKILL);
      break;
    case What::kill_part:
      acts.parts.emplace_back(fault.part, SIGKILL);
      break;
    case What::stop_drone:
      acts.control = {fault.stop_word == StopWord::resume ? "resume" : "stop", fault.drone};
      break;
    case What::burn:
      acts.burn_core = static_cast<int>(fault.value);
      break;
    case What::take_memory:
      acts.take_bytes = static_cast<std::uint64_t>(fault.value);
      break;
    case What::fill_disk:
      acts.fill_disk = true;
      break;
    default:
      break;
  }
  return acts;
}

RealActs acts_at_end(const Fault& fault, const std::vector<Fault>& active, int drones, const RealLedger& ledger) {
  if (fault.momentary() || fault.what == What::kill) return {};
  RealActs acts = set_proxy(fault, active, drones, ledger);
  const bool goes_on = std::any_of(active.begin(), active.end(), [&](const Fault& other) {
    return other.what == fault.what && other.ends == fault.ends && other.value == fault.value;
  });
  if (fault.what == What::sensor) acts.proxy.push_back(sensor_text(fault) + " off");
  if (fault.what == What::take_memory) acts.take_bytes = static_cast<std::uint64_t>(fault.value);
  if (goes_on) return acts;
  if (fault.what == What::stop || fault.what == What::ledger_stall) stop_programs(fault, ledger, SIGCONT, acts);
  if (fault.what == What::fill_disk) acts.fill_disk = true;
  if (fault.what == What::burn) acts.burn_core = static_cast<int>(fault.value);
  return acts;
}

}  // namespace ledgerline::hil
