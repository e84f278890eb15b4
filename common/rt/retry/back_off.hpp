#pragma once
#include <algorithm>

#include "common/base/random.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline {

/// Exponential back-off after failures: doubles up to `max_ns`, with jitter (half to whole), so that the many clients
/// of a ledger that comes back do not all ask at once; a success resets it. One thread.
class BackOff {
 public:
  BackOff(TimeNs first_ns, TimeNs max_ns) : first_ns_(first_ns), max_ns_(max_ns) {}

  /// Another failure: how long to wait now.
  TimeNs next(Random& random) {
    wait_ns_ = std::clamp(2 * wait_ns_, first_ns_, max_ns_);
    return static_cast<TimeNs>(static_cast<double>(wait_ns_) * (0.5 + 0.5 * random.uniform()));
  }
  void succeeded() { wait_ns_ = 0; }

  // The same for those who ask at times whether it is over.
  void failed(TimeNs now, Random& random) { until_ns_ = now + next(random); }
  bool over(TimeNs now) const { return now >= until_ns_; }
  TimeNs until_ns() const { return until_ns_; }

 private:
  TimeNs first_ns_, max_ns_;
  TimeNs wait_ns_ = 0;
  TimeNs until_ns_ = INT64_MIN;
};

}  // namespace ledgerline
