#pragma once
#include <algorithm>
#include <array>
#include <cstdint>

#include "common/msg/onboard.hpp"

namespace ledgerline::link {

/// The transitions of one drone that are not on the ledger yet. With each heartbeat agent says how far it has taken
/// them and how far they are on the ledger: what it has not taken is sent, or sent again; what is on the ledger is
/// forgotten. So no message that is lost, no agent that dies and no ledger that is away loses one. When `capacity` are
/// kept the oldest goes, and counts as lost unless agent has it; a reader of the ledger sees the gap in the numbers. No
/// allocation; one thread.
class TransitionLog {
 public:
  static constexpr std::uint64_t capacity = 256;

  struct Counters {
    std::uint64_t made = 0, on_ledger = 0, lost = 0, kept = 0;
  };

  /// Numbers it.
  void add(Transition transition) noexcept {
    if (newest_ + 1 - oldest_ == capacity) {
      if (oldest_ > taken_) ++lost_;
      ++oldest_;
    }
    transition.number = ++newest_;
    kept_[newest_ % capacity] = transition;
  }

  /// What a heartbeat of agent says of this drone; zeros when it knows another boot, or none.
  void heard(std::uint64_t taken, std::uint64_t on_ledger) noexcept {
    on_ledger_ = std::max(on_ledger_, std::min(on_ledger, newest_));
    oldest_ = std::max(oldest_, on_ledger_ + 1);
    taken_ = std::clamp(taken, on_ledger_, newest_);
    sent_ = taken_;
  }

  /// The next that agent should take; false: it was sent everything.
  bool next(Transition& out) noexcept {
    sent_ = std::max(sent_, oldest_ - 1);
    if (sent_ == newest_) return false;
    out = kept_[++sent_ % capacity];
    out.oldest = oldest_;
    out.lost = lost_;
    return true;
  }

  Counters counters() const noexcept { return {newest_, on_ledger_, lost_, newest_ + 1 - oldest_}; }

 private:
  std::array<Transition, capacity> kept_{};  ///< number n is at n % capacity
  std::uint64_t oldest_ = 1, newest_ = 0;    ///< kept: from the one to the other
  std::uint64_t sent_ = 0;
  std::uint64_t taken_ = 0, on_ledger_ = 0;  ///< by agent; on the ledger
  std::uint64_t lost_ = 0;
};

}  // namespace ledgerline::link
