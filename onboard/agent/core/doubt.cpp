#include "onboard/agent/core/doubt.hpp"

#include "common/base/printable.hpp"

namespace ledgerline::agent {

std::string_view name(DoubtKind kind) {
  constexpr std::array<std::string_view, doubt_kinds> names{"transaction_unbelievable", "records_differ",
                                                            "stop_unconfirmed", "stream_contradicted", "chain_broken"};
  return names.at(static_cast<std::size_t>(kind));
}

void Doubt::add(TimeNs now, DoubtKind kind, std::uint64_t block, std::string_view words, std::uint64_t times) {
  if (times == 0) return;
  Kept& kept = kept_.at(static_cast<std::size_t>(kind));
  kept.reason = {kept.reason.count + times, block, printable(words, max_words)};
  kept.newest_ns = now;
  kept.untold += times;
}

bool Doubt::stands(TimeNs now, DoubtKind kind) const {
  const auto& newest_ns = at(kind).newest_ns;
  return (kind == DoubtKind::records && records_differ_) || (newest_ns && now - *newest_ns < lasts_ns_);
}

bool Doubt::stands(TimeNs now) const {
  for (std::size_t i = 0; i < doubt_kinds; ++i) {
    if (stands(now, static_cast<DoubtKind>(i))) return true;
  }
  return false;
}

std::uint64_t Doubt::count() const {
  std::uint64_t count = 0;
  for (const Kept& kept : kept_) count += kept.reason.count;
  return count;
}

std::vector<Doubt::Word> Doubt::take_words(TimeNs now) {
  std::vector<Word> words;
  for (std::size_t i = 0; i < doubt_kinds; ++i) {
    Kept& kept = kept_[i];
    if (kept.untold == 0 || (kept.told_ns && now - *kept.told_ns < word_gap_ns)) continue;
    words.push_back({static_cast<DoubtKind>(i), kept.untold, kept.reason.count, kept.reason.words});
    kept.untold = 0;
    kept.told_ns = now;
  }
  return words;
}

}  // namespace ledgerline::agent
