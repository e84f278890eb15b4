#include "hil/fault/own/sdk_script.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace ledgerline::hil {
namespace {

/// What of a fault would have to be done to something that is not there; empty: nothing.
std::string beyond_sdk(const Fault& fault, int drones) {
  if (fault.acts.not_real) {
    if (std::string why = fault.acts.not_real(fault, {}); !why.empty()) return why;
  }
  const RealActs acts = acts_at_begin(fault, {fault}, drones, {});
  for (const std::string& command : acts.proxy) {
    if (command.starts_with("server")) return "there is no ledger in a flight by the SDK";
  }
  if (!acts.programs.empty() || !acts.parts.empty() || !acts.control.empty() || acts.fill_disk)
    return "there is no link, agent, ground or ledger in a flight by the SDK";
  return {};
}

}  // namespace

std::vector<NotReal> not_by_sdk(const Script& script) {
  std::vector<NotReal> reasons;
  const WorldConfig usual, &flight = script.flight;
  const struct {
    bool set;
    const char *key, *why;
  } settings[] = {
      {flight.rate_hz != usual.rate_hz, "flight.rate_hz", "it is link's"},
      {!flight.predict, "flight.predict", "it is ground's"},
      {flight.max_age_ns != usual.max_age_ns, "flight.max_age", "it is of commands through a ledger"},
      {flight.idle_evict_ns != usual.idle_evict_ns, "flight.idle_evict", "it is agent's"},
      {flight.blocks != usual.blocks, "flight.blocks", "there is no ledger"},
      {flight.pose != usual.pose, "flight.pose", "it is link's; an SDK client knows what the drone reports"},
      {flight.on_untrusted_ledger != usual.on_untrusted_ledger, "flight.on_untrusted_ledger", "it is link's"},
      {flight.batch_count != usual.batch_count, "flight.batch_count", "there is no ledger"},
      {flight.batch_timeout_ns != usual.batch_timeout_ns, "flight.batch_timeout", "there is no ledger"},
      {flight.drawn_tello, "flight.tello", "ledgerline-sim is the usual Tello"},
      {flight.wifi.has_value(), "flight.wifi", "a fault's recorded-day does it"},
      {!flight.keeps_rc, "flight.keeps_rc", "ledgerline-sim is the usual Tello"},
      {!flight.command_counts, "flight.command_counts", "ledgerline-sim is the usual Tello"},
  };
  for (const auto& [set, key, why] : settings) {
    if (set) reasons.push_back({key, why});
  }
  for (std::size_t i = 0; i < script.faults.size(); ++i) {
    const Fault& fault = script.faults[i];
    if (const std::string why = beyond_sdk(fault, flight.drones); !why.empty())
      reasons.push_back({fmt::format("fault.{}.what", i), fmt::format("\"{}\": {}", fault.text, why)});
    if (fault.trigger.kind == Trigger::Kind::landing)
      reasons.push_back({fmt::format("fault.{}.at", i), "link says when it lands; use `landed`, or a time"});
  }
  for (const Rule& rule : script.must) {
    const std::string_view why =
        rule.kind->needs_link ? "link says that, and there is none in a flight by the SDK" : rule.kind->not_real;
    if (!why.empty()) reasons.push_back({"must", fmt::format("\"{}\": {}", rule.text, why)});
  }
  return reasons;
}

Status check_sdk(const Script& script) {
  std::vector<std::string> lines;
  for (const NotReal& reason : not_by_sdk(script)) lines.push_back(fmt::format("{}: {}", reason.key, reason.what));
  if (lines.empty()) return done;
  return Error{fmt::format("{} cannot be flown by an SDK client:\n  {}", script.name, fmt::join(lines, "\n  "))};
}

}  // namespace ledgerline::hil
