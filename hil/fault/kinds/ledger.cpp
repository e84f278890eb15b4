// Faults of the ledger, of the connections to it, and of those who speak over them.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <csignal>

#include "hil/fault/kinds/parse.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

using ParsedText = FaultKind::ParsedText;

template <typename Tampering>
Error one_of(std::string_view what) {
  return Error{fmt::format("{} must be followed by one of {}", what, fmt::join(words_for<Tampering>(), ", "))};
}

void signal_ledger(RealActs& real, const RealStack& stack, int signal) {
  if (!stack.fabric) real.programs.emplace_back("ledgerline-node", signal);
  for (int k = 1; stack.fabric && k <= fabric_orderers; ++k)
    real.parts.emplace_back(fmt::format("orderer{}", k), signal);
}

Result<FaultActs> stall_ledger(const ParsedText&) {
  return FaultActs{.lasts = [](Effects& effects) { effects.ledger_stalled = true; },
                   .really_begin = [](RealActs& real, const RealStack& stack) { signal_ledger(real, stack, SIGSTOP); },
                   .really_end =
                       [](RealActs& real, const RealStack& stack, bool goes_on) {
                         if (!goes_on) signal_ledger(real, stack, SIGCONT);
                       }};
}

Result<FaultActs> restart_ledger(const ParsedText&) {
  return FaultActs{
      .begin = [](SimulatedWorld& world) { world.restart_ledger(); },
      .check_real = [](const Fault&, const RealStack& stack) -> Status {
        return Error{stack.fabric
                         ? "name the part: `peer 1 kill`, `orderer 1 kill`, `chaincode 1 kill`"
                         : "the embedded node's end is the flight's end: use `ledger stall`, or fly on Fabric"};
      },
      .momentary = true};
}

/// While it goes on, of each of these processes' connections.
template <typename Set>
auto on_ports(std::string_view whose, Set set) {
  return [processes = processes_of(whose), set](Effects& effects) {
    for (const Process process : processes) set(effects.port(process));
  };
}

Result<FaultActs> cut(const ParsedText& parsed) {
  return FaultActs{.lasts = on_ports(parsed.words[0], [](Effects::OfPort& port) { port.cut = true; }),
                   .really_begin = [processes = processes_of(parsed.words[0])](RealActs& real, const RealStack&) {
                     for (const Process process : processes)
                       real.proxy.push_back("server " + servers_of(process) + " cut");
                   }};
}

Result<FaultActs> stale(const ParsedText& parsed) {
  return FaultActs{
      .lasts = on_ports(parsed.words[0], [](Effects::OfPort& port) { port.stale = true; }),
      .check_real = because("a peer that is behind its channel is not built: simulated time alone has it")};
}

Result<FaultActs> tampering(const ParsedText& parsed) {
  const auto tampering = from_word<Tampering>(parsed.rest);
  if (!tampering) return one_of<Tampering>("lies");
  return FaultActs{.lasts = on_ports(parsed.words[0],
                                     [tampering = *tampering](Effects::OfPort& port) { port.tampering = tampering; }),
                   .check_real = because(nobody_real)};
}

Result<FaultActs> serve(const ParsedText& parsed) {
  const auto tampering = from_word<PeerTampering>(parsed.rest);
  if (!tampering) return one_of<PeerTampering>("serves");
  return FaultActs{
      .lasts = on_ports(parsed.words[0], [tampering = *tampering](Effects::OfPort& port) { port.serves = tampering; }),
      .check_real = because(nobody_real)};
}

Result<FaultActs> order(const ParsedText& parsed) {
  const auto tampering = from_word<PeerTampering>(parsed.rest);
  if (!tampering) return one_of<PeerTampering>("orders");
  return FaultActs{
      .lasts = on_ports(parsed.words[0], [tampering = *tampering](Effects::OfPort& port) { port.orders = tampering; }),
      .check_real = because(nobody_real),
      .check_flight = [](const WorldConfig& flight) -> Status {
        return allow_if(flight.blocks == fabric::BlockSource::ordered,
                        "nobody reads blocks as they are ordered here (flight.blocks = \"ordered\")");
      }};
}

// Of several relays the later one in the script counts.
Result<FaultActs> relay(const ParsedText& parsed) {
  const auto words = words_of(parsed.rest);
  const auto tampering = words.empty() ? std::nullopt : from_word<RelayTampering>(words[0]);
  if (!tampering || words.size() > 2 || (words.size() == 2 && words[1] != "compared"))
    return Error{one_of<RelayTampering>("ledger relay").message + ", and may by compared"};
  return FaultActs{.lasts = [tampered = Effects::OfRelay{*tampering, words.size() == 2}](
                                Effects& effects) { effects.relay = tampered; },
                   .check_real = because(nobody_real)};
}

// Without a way: both.
Result<FaultActs> stall_port(const ParsedText& parsed) {
  const bool one_way = parsed.words.size() > 1;
  const bool to = !one_way || parsed.words[1] == "to", from = !one_way || parsed.words[1] == "from";
  return FaultActs{.lasts = on_ports(parsed.words[0], [to, from](Effects::OfPort& port) {
                     port.stall_to = port.stall_to || to;
                     port.stall_from = port.stall_from || from;
                   })};
}

// Of several delays the later one in the script counts.
Result<FaultActs> delay_port(const ParsedText& parsed) {
  const bool one_way = parsed.words.size() > 1;
  const bool to = !one_way || parsed.words[1] == "to", from = !one_way || parsed.words[1] == "from";
  const auto delay = parse_distribution(parsed.rest);
  if (!delay) return delay.error();
  return FaultActs{.lasts = on_ports(parsed.words[0], [to, from, delay = *delay](Effects::OfPort& port) {
                     if (to) port.delay_to = delay;
                     if (from) port.delay_from = delay;
                   })};
}

Result<FaultActs> refuse_effect(const ParsedText& parsed) {
  const std::string effect(parsed.rest.substr(0, parsed.rest.find(' ')));
  for (const std::string_view no : {"loss", "duplicate", "reorder", "corrupt", "truncate", "jitter", "partition"}) {
    if (effect == no)
      return Error{fmt::format("a ledger's connection is a stream (TCP) and has no {}: use delay, stall or cut", no)};
  }
  return Error{
      "must be `ledger agent|ground|both ` and cut, stale, lies WHAT, serves WHAT, orders WHAT, or [to|from] with "
      "stall or delay "
      "DISTRIBUTION"};
}

Result<FaultActs> slip(const ParsedText& parsed) {
  const auto slip = from_word<Slip>(parsed.rest);
  if (!slip) return one_of<Slip>("operator errs");
  return FaultActs{.lasts = on_ports("ground", [slip = *slip](Effects::OfPort& port) { port.slip = slip; }),
                   .check_real = because(nobody_real)};
}

Result<FaultActs> post_control(const ParsedText& parsed) {
  const std::string_view who = parsed.words[0], name = parsed.words[1];
  const Stopper stopper = who == "operator"     ? Stopper::operating
                          : who == "supervisor" ? Stopper::supervisor
                                                : Stopper::outsider;
  const auto word = static_cast<ControlCommand>(std::ranges::find(enum_names<ControlCommand>, name) -
                                                enum_names<ControlCommand>.begin());
  return FaultActs{
      .strike = [stopper, word](SimulatedWorld& world, std::size_t drone) { world.post_control(stopper, drone, word); },
      .really_begin =
          [name = std::string(name), drone = parsed.drone](RealActs& real, const RealStack&) {
            real.control = {name, drone};
          },
      .check_real = [stopper, word](const Fault&, const RealStack&) -> Status {
        if (stopper != Stopper::operating)
          return Error{"nobody but the operator speaks there: simulated time alone has it"};
        if (word == ControlCommand::cut)
          return Error{"a real flight's motors are not cut: simulated time alone has it"};
        return allow_if(word == ControlCommand::stop || word == ControlCommand::clear_stop,
                        "a real flight keeps its lease: simulated time alone has it");
      },
      .momentary = true,
      .pushes = word == ControlCommand::cut,
      .needs_supervisors = stopper != Stopper::operating || word == ControlCommand::hand_over,
      .cuts = word == ControlCommand::cut};
}

Result<FaultActs> revoke(const ParsedText&) {
  return FaultActs{
      .strike = [](SimulatedWorld& world,
                   std::size_t drone) { world.post_control(Stopper::administrator, drone, ControlCommand::revoke); },
      .check_real = because("nobody but the operator speaks there: simulated time alone has it"),
      .momentary = true};
}

constexpr FaultKind ledger_table[] = {
    {"ledger stall", stall_ledger},
    {"ledger restart", restart_ledger},
    {"ledger agent|ground|both cut", cut},
    {"ledger agent|ground|both stale", stale},
    {"ledger agent|ground|both stall", stall_port},
    {"ledger agent|ground|both to|from stall", stall_port},
    {"ledger agent|ground|both delay DISTRIBUTION...", delay_port},
    {"ledger agent|ground|both to|from delay DISTRIBUTION...", delay_port},
    {"ledger agent|ground|both EFFECTS...", refuse_effect},
    {"ledger agent|ground|both to|from EFFECTS...", refuse_effect},
    {"ledger agent|ground|both lies WHAT...", tampering},
    {"ledger agent|ground|both serves WHAT...", serve},
    {"ledger agent|ground|both orders WHAT...", order},
    {"ledger relay LIE...", relay},
    {"operator errs WHAT...", slip},
    {"operator|supervisor|outsider stop|cut|clear_stop|acquire|claim|evict|request|hand_over|deny NAME", post_control},
    {"administrator revoke NAME", revoke},
};

}  // namespace

std::string servers_of(Process process) { return std::string(name_of(process)) + "*"; }

std::span<const FaultKind> ledger_faults() { return ledger_table; }

}  // namespace ledgerline::hil
