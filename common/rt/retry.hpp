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

struct BackOffLimits {
  TimeNs first_ns = 20 * ns_per_ms;  ///< after the first failure
  TimeNs max_ns = 1 * ns_per_s;
};

/// Exponential back-off after failures: doubles up to its limit, with jitter (half to whole), so that the many clients
/// of a ledger that comes back do not all ask at once; a success resets it. One thread.
class BackOff {
 public:
  explicit BackOff(const BackOffLimits& limits) : limits_(limits) {}
  BackOff(TimeNs first_ns, TimeNs max_ns) : limits_{first_ns, max_ns} {}

  /// Another failure: how long to wait now.
  TimeNs next(Random& random) {
    wait_ns_ = std::clamp(2 * wait_ns_, limits_.first_ns, limits_.max_ns);
    return static_cast<TimeNs>(static_cast<double>(wait_ns_) * (0.5 + 0.5 * random.uniform()));
  }
  void succeeded() { wait_ns_ = 0; }

  // The same for those who ask at times whether it is over.
  void failed(TimeNs now, Random& random) { until_ns_ = now + next(random); }
  bool over(TimeNs now) const { return now >= until_ns_; }
  TimeNs until_ns() const { return until_ns_; }

 private:
  BackOffLimits limits_;
  TimeNs wait_ns_ = 0;
  TimeNs until_ns_ = INT64_MIN;
};

/// Runs what is wanted at once, then at most once per `gap_ns`, however often it is asked for. Deterministic; one
/// thread.
class RateLimiter {
 public:
  explicit RateLimiter(TimeNs gap_ns) : gap_ns_(gap_ns) {}

  void request() { is_wanted_ = true; }
  /// True: do it now.
  bool start(TimeNs now) {
    if (!is_wanted_ || now < next_ns_) return false;
    is_wanted_ = false;
    next_ns_ = now + gap_ns_;
    return true;
  }

 private:
  const TimeNs gap_ns_;
  TimeNs next_ns_ = 0;
  bool is_wanted_ = false;
};

}  // namespace ledgerline
