#include "onboard/agent/core/integrity_monitor.hpp"

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
  Kept& kept = kept_.at(static_cast<std::size_t>(kind));
  kept.reason = {kept.reason.count + times, block, printable(words, max_words)};
  kept.newest_ns = now;
  kept.unreported += times;
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
  for (const Kept& kept : kept_) count += kept.reason.count;
  return count;
}

std::vector<IntegrityMonitor::Word> IntegrityMonitor::take_words(TimeNs now) {
  std::vector<Word> words;
  for (std::size_t i = 0; i < violation_kinds; ++i) {
    Kept& kept = kept_[i];
    if (kept.unreported == 0 || (kept.reported_ns && now - *kept.reported_ns < word_gap_ns)) continue;
    words.push_back({static_cast<IntegrityViolation>(i), kept.unreported, kept.reason.count, kept.reason.words});
    kept.unreported = 0;
    kept.reported_ns = now;
  }
  return words;
}

}  // namespace ledgerline::agent
