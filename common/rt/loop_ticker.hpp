#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"
#include "common/rt/histogram.hpp"
#include "common/rt/trace.hpp"

namespace ledgerline {

/// The ticks of a time-triggered loop: a turn is due every period. One that begins more than a period late is an
/// overrun; the turns missed by it are not made up for. One thread; system calls: clock and sleep; no allocation.
class LoopTicker {
 public:
  explicit LoopTicker(TimeNs period_ns) noexcept : period_ns_(period_ns), next_ns_(monotonic_ns() + period_ns) {}

  /// Sleeps until the next turn is due; the time when it really began.
  TimeNs wait() noexcept;
  /// When the turn that began last was due.
  TimeNs due_ns() const noexcept { return due_ns_; }

  std::uint64_t count() const noexcept { return late_.count(); }
  std::uint64_t overruns() const noexcept { return overruns_; }
  const Histogram& late() const noexcept { return late_; }

 private:
  TimeNs period_ns_;
  TimeNs next_ns_;
  TimeNs due_ns_ = 0;
  std::uint64_t overruns_ = 0;
  Histogram late_;
};

/// How late each turn began, 16 turns a trace record: 4 bytes a turn. One thread; no allocation.
class PackedTurns {
 public:
  static constexpr std::size_t capacity = 16;

  /// True when record() is full: hand it over before the next one.
  bool add(TimeNs due_ns, TimeNs begun_ns) noexcept;
  /// Those since the last full one; `extra` says how many.
  const TraceRecord& record() const noexcept { return record_; }

  /// Microseconds of each; 65,535: that and more. Empty for a record of another kind or with an impossible count.
  static std::vector<std::uint16_t> late_us(const TraceRecord& record);

 private:
  TraceRecord record_;
  std::array<std::uint16_t, capacity> late_us_{};
  std::uint64_t turns_ = 0;
};

/// What the calling thread and its process got of what was asked for.
struct RealTime {
  bool scheduled = false;            ///< SCHED_FIFO
  bool locked = false;               ///< all memory in RAM
  std::vector<std::string> notices;  ///< what was refused, and what would allow it
  bool all() const { return scheduled && locked; }
};

/// Puts the calling thread under SCHED_FIFO at `priority` (1 to 98); threads that it starts are ordinary again.
Status schedule_fifo(int priority);

/// For the calling thread: SCHED_FIFO at `priority` (0: none wanted), pinned to `cpu` (-1: any), memory locked. What is
/// not permitted is a notice, not an error: on a developer's computer the loop runs well enough without.
RealTime enter_real_time(int priority, int cpu);

}  // namespace ledgerline
