#pragma once
#include <algorithm>
#include <cstdint>
#include <functional>
#include <string>

#include "common/base/random.hpp"
#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline {

struct TryLimits {
  /// From the first attempt; an attempt that began before ends in its own time. RouDi and the embedded ledger are there
  /// within a second; somebody who starts programs by hand needs a few.
  TimeNs within_ns = 15 * ns_per_s;
  /// Twice as long after each attempt, with jitter (BackOff): short beside a start, and for a person who waits.
  TimeNs first_pause_ns = 10 * ns_per_ms, max_pause_ns = 200 * ns_per_ms;
  /// The wait is in the log from then on, and so often. Most are over before.
  TimeNs say_first_after_ns = 500 * ns_per_ms, say_again_after_ns = 3 * ns_per_s;
};

/// What retry() lives in: this thread, its clock and the log; a test brings its own.
struct TryWorld {
  std::function<TimeNs()> now;
  std::function<void(TimeNs)> sleep;
  std::function<void(const std::string&)> warn;
  std::uint64_t seed = 0;  ///< of the pauses' jitter

  static TryWorld real();
};

/// Waits for what may not be there yet, in the calling thread: repeats until an attempt succeeds. An error once `stop`
/// says so ("asked to end before WHAT") or the time is over (its last error). `what`: "RouDi answers".
Status retry(const std::string& what, const TryLimits& limits, const std::function<bool()>& stop,
             const std::function<Status()>& attempt, const TryWorld& world = TryWorld::real());

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
