#include "onboard/agent/core/outbox/integrity.hpp"

#include <utility>

#include "common/base/text.hpp"

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

AlarmSender::AlarmSender(const BackOffLimits& back_off, const std::vector<DroneName>& drones, std::uint64_t seed)
    : pause_(back_off), random_(seed) {
  for (const DroneName& drone : drones) slots_.push_back(Slot{.drone = drone});
}

bool AlarmSender::is_due(const Slot& slot, TimeNs now, const ReportedAlarm& truth) const {
  const bool rested = now >= slot.rest_until_ns;
  if (slot.refused && !rested) return false;
  return truth.stands != slot.reported.stands || (truth.count != slot.reported.count && rested);
}

std::optional<AlarmSender::Sending> AlarmSender::next(TimeNs now, const IntegrityMonitor& integrity) {
  if (call_ != 0 || !pause_.over(now) || integrity.count() == 0) return std::nullopt;
  const ReportedAlarm truth{integrity.stands(now), integrity.count()};
  Sending sending;
  for (Slot& slot : slots_) {
    if ((alone_ && !sending.drones.empty()) || !is_due(slot, now, truth)) continue;
    slot.sending = true;
    sending.drones.push_back(&slot.drone);
  }
  if (sending.drones.empty()) return std::nullopt;
  sending.number = call_ = ++last_call_;
  sending_ = truth;
  return sending;
}

bool AlarmSender::finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome) {
  if (number == 0 || number != call_) return false;
  call_ = 0;
  const bool committed = outcome.kind == fabric::Outcome::Kind::committed;
  const bool refused = outcome.kind == fabric::Outcome::Kind::refused;
  for (Slot& slot : slots_) {
    if (!std::exchange(slot.sending, false)) continue;
    if (committed) slot.reported = sending_;
    slot.refused = refused && alone_;
    if (committed || slot.refused) slot.rest_until_ns = now + gap_ns;
  }
  if (committed) {
    ++counters_.on_ledger;
    pause_.succeeded();
    return true;
  }
  ++(refused ? counters_.refused : counters_.repeated);
  if (refused) alone_ = true;
  pause_.failed(now, random_);
  return true;
}

}  // namespace ledgerline::agent
