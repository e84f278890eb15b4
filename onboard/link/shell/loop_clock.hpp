#pragma once
#include <atomic>

#include "common/rt/loop_ticker.hpp"

namespace ledgerline::link {

/// When the loop's turns are, and what time it is in them: this computer's clock, or one that the shim moves
/// (lockstep). The loop's thread.
class LoopClock {
 public:
  virtual ~LoopClock() = default;

  /// Waits for the next turn; its time. The turn before is over with this call. `stopping`: link is asked to end, so a
  /// clock that stands is lost.
  virtual TimeNs wait(const std::atomic<bool>& stopping) noexcept = 0;
  /// When the newest turn was due.
  virtual TimeNs due_ns() const noexcept = 0;
  virtual TimeNs now() const noexcept = 0;
  /// How long the host was suspended since it booted: now() stood still meanwhile.
  virtual TimeNs suspended_ns() const noexcept = 0;
  /// Nobody moves it any more: there will be no turn.
  virtual bool lost() const noexcept = 0;

  /// Turns that began more than a period late, and how late each one began.
  virtual std::uint64_t overruns() const noexcept = 0;
  virtual const Histogram& late() const noexcept = 0;
};

/// CLOCK_MONOTONIC, a turn every period; its system calls are the clock and the sleep.
class RealClock final : public LoopClock {
 public:
  explicit RealClock(TimeNs period_ns) noexcept : turns_(period_ns) {}
  TimeNs wait(const std::atomic<bool>&) noexcept override { return turns_.wait(); }
  TimeNs due_ns() const noexcept override { return turns_.due_ns(); }
  TimeNs now() const noexcept override { return monotonic_ns(); }
  /// CLOCK_MONOTONIC stands still while the host is suspended, CLOCK_BOOTTIME goes on. The one is read behind the
  /// other, so the difference jitters by what lies between.
  TimeNs suspended_ns() const noexcept override {
    const TimeNs monotonic = monotonic_ns();
    return read_clock(CLOCK_BOOTTIME) - monotonic;
  }
  bool lost() const noexcept override { return false; }
  std::uint64_t overruns() const noexcept override { return turns_.overruns(); }
  const Histogram& late() const noexcept override { return turns_.late(); }

 private:
  LoopTicker turns_;
};

}  // namespace ledgerline::link
