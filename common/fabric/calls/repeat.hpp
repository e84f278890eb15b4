#pragma once
#include <cstdint>

#include "common/base/random.hpp"
#include "common/fabric/calls/outcome.hpp"
#include "common/rt/clock.hpp"
#include "common/rt/retry.hpp"

namespace ledgerline::fabric {

struct RepeatLimits {
  TimeNs first_pause_ns = 50 * ns_per_ms;  ///< a block or two of a near ledger
  /// Of a call that has to get through, for a ledger that comes back: so late it is asked at most.
  TimeNs max_pause_ns = 250 * ns_per_ms;
  TimeNs within_ns = 30 * ns_per_s;  ///< from the beginning; then it is given up
  int attempts = 1'000'000;
  bool conflicts_only = false;  ///< what may pass otherwise is left to the caller
};

/// Whether and when a call is made again: until it is on the ledger, the contract refuses it, or a limit is reached,
/// with twice the pause each time and jitter. Decides alone, without I/O: one object a call, whose attempts are made
/// one after the other. One thread; the same inputs and seed give the same times.
class Repeat {
 public:
  enum class Next : std::uint8_t {
    on_ledger,  ///< committed: over
    refused,    ///< by the contract: over
    again,      ///< at at_ns()
    given_up,   ///< over, and it may or may not come yet
  };

  Repeat(const RepeatLimits& limits, std::uint64_t seed, TimeNs now)
      : limits_(limits),
        random_(seed),
        pause_(limits.first_pause_ns, limits.max_pause_ns),
        until_ns_(now > INT64_MAX - limits.within_ns ? INT64_MAX : now + limits.within_ns) {}

  /// How the newest attempt ended.
  Next ended(TimeNs now, const Outcome& outcome) {
    ++attempts_;
    if (outcome.kind == Outcome::Kind::committed) return Next::on_ledger;
    if (outcome.refusal) return Next::refused;
    pause_.failed(now, random_);
    const bool may_pass = !limits_.conflicts_only || lost_to_another(outcome);
    return may_pass && attempts_ < limits_.attempts && pause_.until_ns() < until_ns_ ? Next::again : Next::given_up;
  }

  TimeNs at_ns() const { return pause_.until_ns(); }
  int attempts() const { return attempts_; }

 private:
  RepeatLimits limits_;
  Random random_;
  BackOff pause_;
  TimeNs until_ns_;
  int attempts_ = 0;
};

}  // namespace ledgerline::fabric
