// Faults of processes, and of the machine that they run on.
#include <fmt/format.h>

#include <cmath>
#include <csignal>

#include "hil/fault/kinds/parse.hpp"

namespace ledgerline::hil {
namespace {

using ParsedText = FaultKind::ParsedText;

constexpr TimeNs max_death_ns = ns_per_s;  // the launcher starts again what died, within half a second

void signal(RealActs& real, Process process, int signal) {
  real.programs.emplace_back("ledgerline-" + name_of(process), signal);
}

Result<FaultActs> kill(const ParsedText& parsed) {
  const Process process = processes_of(parsed.words[0])[0];
  return FaultActs{.begin = [process](SimulatedWorld& world) { world.kill(process); },
                   .end = [process](SimulatedWorld& world) { world.start(process); },
                   .really_begin = [process](RealActs& real, const RealStack&) { signal(real, process, SIGKILL); },
                   .check_real = [process](const Fault& fault, const RealStack&) -> Status {
                     if (process == Process::ground)
                       return Error{"ground's end is the flight's end: use `ground stop`"};
                     return allow_if(fault.for_ns > 0 && fault.for_ns <= max_death_ns,
                                     "the launcher starts it again at once: `for` must be at most 1 s");
                   },
                   .stops_link = process == Process::link,
                   .kills = enum_names<Process>[static_cast<std::size_t>(process)]};
}

Result<FaultActs> stop(const ParsedText& parsed) {
  const Process process = processes_of(parsed.words[0])[0];
  return FaultActs{.lasts = [process](Effects& effects) { effects.stopped[static_cast<std::size_t>(process)] = true; },
                   .really_begin = [process](RealActs& real, const RealStack&) { signal(real, process, SIGSTOP); },
                   .really_end =
                       [process](RealActs& real, const RealStack&, bool goes_on) {
                         if (!goes_on) signal(real, process, SIGCONT);
                       },
                   .stops_link = process == Process::link};
}

Result<FaultActs> end_link(const ParsedText&) {
  return FaultActs{.begin = [](SimulatedWorld& world) { world.end_link(); },
                   .check_real = because("link's end is the flight's end: simulated time alone has it"),
                   .momentary = true,
                   .for_good = true,
                   .stops_link = true};
}

Result<FaultActs> restart_link(const ParsedText&) {
  return FaultActs{.begin = [](SimulatedWorld& world) { world.end_link(true); },
                   .check_real = because("the launcher takes link's end for the flight's: simulated time alone has it"),
                   .momentary = true,
                   .stops_link = true};
}

constexpr const char* not_its_clock = "the machine's clock is not this flight's alone: simulated time alone has it";

Result<TimeNs> jump_of(std::string_view word) {
  const bool back = word.starts_with('-');
  const auto by = parse_time(word.substr(back ? 1 : 0));
  if (!by) return by.error();
  return back ? -*by : *by;
}

Result<FaultActs> jump_clock(const ParsedText& parsed) {
  const auto by = jump_of(parsed.words[0]);
  if (!by) return by.error();
  return FaultActs{.begin = [by_ns = *by](SimulatedWorld& world) { world.clock().jump(by_ns); },
                   .check_real = because(not_its_clock),
                   .momentary = true};
}

WorldClock::Host host_of(std::string_view word) {
  return word == "mocap" ? WorldClock::Host::mocap : WorldClock::Host::drones;
}

// Its stamps are of another time than they say, by a second at most: older ones are refused.
constexpr double off_clock_m = 1;

Result<FaultActs> jump_clock_of(const ParsedText& parsed) {
  const auto by = jump_of(parsed.words[1]);
  if (!by) return by.error();
  return FaultActs{.begin = [host = host_of(parsed.words[0]),
                             by_ns = *by](SimulatedWorld& world) { world.clock().jump(host, by_ns); },
                   .check_real = because(not_its_clock),
                   .momentary = true,
                   .for_good = true,
                   .misleads_m = off_clock_m};
}

Result<FaultActs> drift_clock_of(const ParsedText& parsed) {
  const auto share = parse_number(parsed.words[1]);
  if (!share || *share == 0 || std::abs(*share) > 0.1)
    return Error{"drift must be followed by seconds a second, up to 0.1 and not 0"};
  return FaultActs{.lasts = [host = static_cast<std::size_t>(host_of(parsed.words[0])),
                             share = *share](Effects& effects) { effects.clock_drift[host] += share; },
                   .check_real = because(not_its_clock),
                   .for_good = true,
                   .misleads_m = off_clock_m};
}

Result<FaultActs> suspend_host(const ParsedText&) {
  return FaultActs{.begin = [](SimulatedWorld& world) { world.clock().suspend_host(true); },
                   .end = [](SimulatedWorld& world) { world.clock().suspend_host(false); },
                   .check_real = because("who looks on would sleep with it: simulated time alone has it"),
                   .stops_link = true};
}

constexpr FaultKind process_table[] = {
    {"agent|link|ground kill", kill},
    {"agent|link|ground stop", stop},
    {"link end", end_link},
    {"link restart", restart_link},
    {"clock jump TIME", jump_clock},
    {"clock mocap|drones jump TIME", jump_clock_of},
    {"clock mocap|drones drift RATE", drift_clock_of},
    {"host suspend", suspend_host},
};

Result<FaultActs> kill_part_named(const std::string& part) {
  return FaultActs{.really_begin = [part](RealActs& real, const RealStack&) { real.parts.emplace_back(part, SIGKILL); },
                   .check_real = [](const Fault&, const RealStack& stack) -> Status {
                     return allow_if(stack.fabric, "it is a part of Fabric: fly on it with --ledger fabric");
                   },
                   .momentary = true};
}

Result<FaultActs> kill_leader(const ParsedText&) { return kill_part_named(leader_part); }

Result<FaultActs> kill_part(const ParsedText& parsed) {
  const auto number = parse_number(parsed.words[1]);
  if (!number || *number < 1 || *number > 3 || *number != std::floor(*number))
    return Error{fmt::format("must be `{} N kill`, N from 1 to 3", parsed.words[0])};
  return kill_part_named(fmt::format("{}{:.0f}", parsed.words[0], *number));
}

Result<FaultActs> kill_roudi(const ParsedText&) {
  return FaultActs{
      .really_begin = [](RealActs& real, const RealStack&) { real.programs.emplace_back("ledgerline-roudi", SIGKILL); },
      .momentary = true,
      .kills = "roudi"};
}

Result<FaultActs> burn_core(const ParsedText& parsed) {
  const auto core = parse_number(parsed.words[0]);
  if (!core || *core < 0 || *core >= 1024 || *core != std::floor(*core))
    return Error{"must be `cpu N burn`, N being a core from 0 on"};
  return FaultActs{
      .really_begin = [core = static_cast<int>(*core)](RealActs& real, const RealStack&) { real.burn_core = core; },
      .really_end =
          [core = static_cast<int>(*core)](RealActs& real, const RealStack&, bool goes_on) {
            if (!goes_on) real.burn_core = core;
          }};
}

Result<FaultActs> take_memory(const ParsedText& parsed) {
  const std::string_view size = parsed.words[0];
  const auto megabytes = size.ends_with("MB") ? parse_number(size.substr(0, size.size() - 2)) : std::nullopt;
  if (!megabytes || *megabytes < 1 || *megabytes > 1e6) return Error{"must be `memory take 500MB`, with at least 1MB"};
  const auto bytes = static_cast<std::uint64_t>(*megabytes * 1e6);
  return FaultActs{.really_begin = [bytes](RealActs& real, const RealStack&) { real.take_bytes = bytes; },
                   .really_end = [bytes](RealActs& real, const RealStack&, bool) { real.take_bytes = bytes; }};
}

Result<FaultActs> fill_disk(const ParsedText&) {
  return FaultActs{.really_begin = [](RealActs& real, const RealStack&) { real.fill_disk = true; },
                   .really_end = [](RealActs& real, const RealStack&, bool goes_on) { real.fill_disk = !goes_on; },
                   .check_real = [](const Fault&, const RealStack& stack) -> Status {
                     return allow_if(!stack.fabric, "Fabric's parts end on a full disk: fly on the embedded node");
                   },
                   .fills_disk = true};
}

constexpr FaultKind machine_table[] = {
    {"peer|orderer|chaincode N kill", kill_part, true},
    {"orderer leader kill", kill_leader, true},
    {"roudi kill", kill_roudi, true},
    {"cpu N burn", burn_core, true},
    {"memory take SIZE", take_memory, true},
    {"disk full", fill_disk, true},
};

}  // namespace

std::span<const FaultKind> process_faults() { return process_table; }
std::span<const FaultKind> machine_faults() { return machine_table; }

}  // namespace ledgerline::hil
