#include "onboard/agent/core/outbox/alarm_sender.hpp"

#include <utility>

namespace ledgerline::agent {

AlarmSender::AlarmSender(const BatchConfig& config, const std::vector<DroneName>& drones, std::uint64_t seed)
    : pause_(config.first_back_off_ns, config.max_back_off_ns), random_(seed) {
  for (const DroneName& drone : drones) slots_.push_back(Slot{.drone = drone});
}

bool AlarmSender::due(const Slot& slot, TimeNs now, const ReportedAlarm& truth) const {
  const bool rested = now >= slot.rest_until_ns;
  if (slot.refused && !rested) return false;
  return truth.stands != slot.said.stands || (truth.count != slot.said.count && rested);
}

std::optional<AlarmSender::Sending> AlarmSender::next(TimeNs now, const IntegrityMonitor& integrity) {
  if (call_ != 0 || !pause_.over(now) || integrity.count() == 0) return std::nullopt;
  const ReportedAlarm truth{integrity.stands(now), integrity.count()};
  Sending sending;
  for (Slot& slot : slots_) {
    if ((alone_ && !sending.drones.empty()) || !due(slot, now, truth)) continue;
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
    if (committed) slot.said = sending_;
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
