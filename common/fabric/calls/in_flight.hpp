#pragma once
#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "common/fabric/calls/outcome.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::fabric {

/// The calls of one stream that have not ended, oldest first, and whether another may go, up to `max`: at once while
/// none is in flight, else after a gap. Each transaction costs the ledger far more than the samples in it, so waiting
/// for the commit is best as long as that is quick; where blocks are cut late it would leave the ledger idle. The gap
/// is the longer one of
///  - four times what endorsing and ordering took recently, within 10 to 200 ms. That is the ledger's work, without
///    the wait for a block to be cut. A ledger at its limit gets fewer transactions.
///  - an eighth of the oldest one's age: while a ledger is away, less and less is added.
/// `T` is what the sender needs when the call ends. One thread.
///
///     add() -> in flight -> end(): its outcome came
///                  |          ^
///                  +- mark_in_block(): in a block, its outcome still to come; no other call waits for it
template <typename T>
class InFlight {
 public:
  static constexpr std::size_t max = 32;
  static constexpr TimeNs min_gap_ns = 10 * ns_per_ms, max_gap_ns = 200 * ns_per_ms;
  struct Entry {
    std::uint64_t number = 0;
    TimeNs submitted_ns = 0;
    T what;
    bool in_block = false;
  };

  void add(std::uint64_t number, TimeNs now, T what) {
    last_ns_ = now;
    entries_.push_back({number, now, std::move(what)});
  }

  /// Takes the call out; nothing if it is not in flight (then nothing changes).
  std::optional<Entry> end(std::uint64_t number, const Outcome& outcome) {
    const auto found =
        std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) { return entry.number == number; });
    if (found == entries_.end()) return std::nullopt;
    Entry entry = std::move(*found);
    entries_.erase(found);
    if (outcome.ordered_after_ns != 0) {
      smoothed_ns_ = smoothed_ns_ == 0 ? outcome.ordered_after_ns : (7 * smoothed_ns_ + outcome.ordered_after_ns) / 8;
      gap_ns_ = std::clamp(4 * smoothed_ns_, min_gap_ns, max_gap_ns);
    }
    return entry;
  }

  /// The oldest call in flight of which `is` holds is in a block; when it was submitted.
  template <typename Is>
  std::optional<TimeNs> mark_in_block(const Is& is) {
    const auto found = std::find_if(entries_.begin(), entries_.end(),
                                    [&](const Entry& entry) { return !entry.in_block && is(entry.what); });
    if (found == entries_.end()) return std::nullopt;
    found->in_block = true;
    return found->submitted_ns;
  }

  bool full() const { return entries_.size() >= max; }
  /// By the gap alone, behind the newest call of all.
  bool may_go(TimeNs now) const { return now >= next_ns(); }
  /// The earliest time at which may_go() holds, if no call ends before.
  TimeNs next_ns() const { return next_ns_behind(last_ns_); }
  /// The same after the newest call in flight: one in a block does not count any more, even if it is newer.
  bool may_go_behind_open(TimeNs now) const {
    const auto newest = std::find_if(entries_.rbegin(), entries_.rend(), is_open);
    return newest == entries_.rend() || now >= next_ns_behind(newest->submitted_ns);
  }

  std::size_t size() const { return entries_.size(); }
  bool empty() const { return entries_.empty(); }
  /// Of the newest call, ended or not.
  TimeNs last_ns() const { return last_ns_; }

 private:
  static bool is_open(const Entry& entry) { return !entry.in_block; }
  // An eighth of the oldest one's age when the call goes is a seventh of its age when the last one went.
  TimeNs next_ns_behind(TimeNs last_ns) const {
    const auto oldest = std::find_if(entries_.begin(), entries_.end(), is_open);
    if (oldest == entries_.end()) return INT64_MIN;
    return last_ns + std::max(gap_ns_, (last_ns - oldest->submitted_ns + 6) / 7);
  }

  std::vector<Entry> entries_;
  TimeNs smoothed_ns_ = 0;
  TimeNs gap_ns_ = 10 * min_gap_ns;  // until something is known
  TimeNs last_ns_ = INT64_MIN / 2;
};

}  // namespace ledgerline::fabric
