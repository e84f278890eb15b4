#pragma once
#include <deque>
#include <optional>

#include "common/base/random.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline {

/// When a process that ended is started again: after a wait that doubles with each end within `within`, with jitter
/// (half to whole of it), so that processes that died together do not start together. After more than `most` ends
/// within `within` it is given up.
///
///     runs -- ended() --> waits -- the time it gave --> runs
///                 \-- nullopt: given up
class Restarts {
 public:
  struct Limits {
    int max_restarts = 10;  ///< within `within`
    TimeNs within = 60 * ns_per_s;
    TimeNs first_wait = 100 * ns_per_ms, max_wait = 5 * ns_per_s;
  };
  Restarts(Limits limits, std::uint64_t seed) : limits_(limits), random_(seed) {}

  /// It ended: when to start it again.
  std::optional<TimeNs> ended(TimeNs now);
  /// How often it has been given a new start.
  std::uint64_t count() const { return count_; }
  const Limits& limits() const { return limits_; }

 private:
  const Limits limits_;
  Random random_;
  std::deque<TimeNs> recent_;  ///< at most limits_.max_restarts
  std::uint64_t count_ = 0;
};

}  // namespace ledgerline
