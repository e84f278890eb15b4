#pragma once
#include <algorithm>

#include "common/fabric/sending/outcome.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::fabric {

/// When the next transaction of a stream may go while earlier ones are not committed yet. Each transaction costs the
/// ledger far more than the samples in it, so waiting for the commit is best as long as that is quick; where blocks are
/// cut late it would leave the ledger idle. So: behind a gap, which is
///  - four times what endorsing and ordering took lately (within 10 to 200 ms). That is the ledger's work; waiting for
///    a block to be cut is not in it. A ledger at its limit gets fewer transactions.
///  - at least an eighth of the oldest one's age: while a ledger is away, less and less is added.
class Pacing {
 public:
  static constexpr TimeNs min_ns = 10 * ns_per_ms, max_ns = 200 * ns_per_ms;

  /// `oldest`, `last`: when the oldest of those that are not committed was submitted, and the last one.
  bool may_go(TimeNs now, TimeNs oldest, TimeNs last) const {
    return now - last >= std::max(gap_ns_, (now - oldest) / 8);
  }
  /// The earliest time at which may_go() holds of the same two.
  TimeNs next_ns(TimeNs oldest, TimeNs last) const { return last + std::max(gap_ns_, (last - oldest + 6) / 7); }
  void ended(const Outcome& outcome) {
    if (outcome.ordered_after_ns == 0) return;
    smoothed_ns_ = smoothed_ns_ == 0 ? outcome.ordered_after_ns : (7 * smoothed_ns_ + outcome.ordered_after_ns) / 8;
    gap_ns_ = std::clamp(4 * smoothed_ns_, min_ns, max_ns);
  }
  TimeNs gap_ns() const { return gap_ns_; }

 private:
  TimeNs smoothed_ns_ = 0;
  TimeNs gap_ns_ = 10 * min_ns;  // until something is known
};

}  // namespace ledgerline::fabric
