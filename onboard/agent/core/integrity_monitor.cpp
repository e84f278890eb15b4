#include "onboard/agent/core/integrity_monitor.hpp"

#include "common/base/printable.hpp"

namespace ledgerline::agent {

std::string_view name(IntegrityViolation kind) {
  constexpr std::array<std::string_view, violation_kinds> names{
      "transaction_unverified", "records_differ", "stop_unconfirmed", "stream_contradicted", "chain_broken"};
  return names.at(static_cast<std::size_t>(kind));
}

void IntegrityMonitor::add(TimeNs now, IntegrityViolation kind, std::uint64_t block, std::string_view words,
                           std::uint64_t times) {
  if (times == 0) return;
  Violations& of_kind = all_.at(static_cast<std::size_t>(kind));
  of_kind.reason = {of_kind.reason.count + times, block, printable(words, max_text_bytes)};
  of_kind.newest_ns = now;
  of_kind.unreported += times;
}

bool IntegrityMonitor::stands(TimeNs now, IntegrityViolation kind) const {
  const auto& newest_ns = at(kind).newest_ns;
  return (kind == IntegrityViolation::records && records_differ_) || (newest_ns && now - *newest_ns < lasts_ns_);
}

bool IntegrityMonitor::stands(TimeNs now) const {
  for (std::size_t i = 0; i < violation_kinds; ++i) {
    if (stands(now, static_cast<IntegrityViolation>(i))) return true;
  }
  return false;
}

std::uint64_t IntegrityMonitor::count() const {
  std::uint64_t count = 0;
  for (const Violations& of_kind : all_) count += of_kind.reason.count;
  return count;
}

std::vector<IntegrityMonitor::LogEntry> IntegrityMonitor::pop_log_entries(TimeNs now) {
  std::vector<LogEntry> entries;
  for (std::size_t i = 0; i < violation_kinds; ++i) {
    Violations& of_kind = all_[i];
    if (of_kind.unreported == 0 || (of_kind.reported_ns && now - *of_kind.reported_ns < log_gap_ns)) continue;
    entries.push_back(
        {static_cast<IntegrityViolation>(i), of_kind.unreported, of_kind.reason.count, of_kind.reason.words});
    of_kind.unreported = 0;
    of_kind.reported_ns = now;
  }
  return entries;
}

}  // namespace ledgerline::agent
