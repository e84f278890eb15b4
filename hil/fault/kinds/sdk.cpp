// Faults at the SDK's own calls.
#include "hil/fault/kinds/said.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"
#include "hil/sitl/facts.hpp"

namespace ledgerline::hil {
namespace {

using ParsedWords = FaultKind::ParsedWords;

Result<FaultActs> sdk(const ParsedWords& said) {
  const auto fault = parse_sdk_fault(std::string(said.words[0]) + " " + said.rest);
  if (!fault) return fault.error();
  return FaultActs{
      .lasts_on =
          [fault = *fault](Effects::OfDrone& drone, std::size_t item) {
            drone.sdk.push_back(fault);
            drone.sdk.back().item = item;
          },
      .really_begin = [text = said.text](RealActs& real, const RealStack&) { real.proxy.push_back(text); },
      .really_end = [text = said.text](RealActs& real, const RealStack&, bool) { real.proxy.push_back(text + " off"); },
      .check_real = [](const Fault&, const RealStack& stack) -> Status {
        return allow_if(stack.shim,
                        "the proxy knows datagrams, not the SDK's calls: simulated time has it, and the shim "
                        "(--shim, docs/faults.md)");
      },
      // As a state text that says another velocity or heading, up to the other way round.
      .misleads_mps = of_states(fault->kind) ? 2 * rc_full_mps : 0,
      .of_two_drones = fault->kind == SdkFault::Kind::other_drone};
}

constexpr FaultKind sdk_table[] = {
    {"sdk NAME answers|states WHAT...", sdk},
};

}  // namespace

std::span<const FaultKind> sdk_faults() { return sdk_table; }

}  // namespace ledgerline::hil
