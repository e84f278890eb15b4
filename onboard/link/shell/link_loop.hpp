#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <string>

#include "common/base/result.hpp"
#include "common/rt/histogram.hpp"
#include "common/rt/loop_ticker.hpp"
#include "common/rt/spsc_ring.hpp"
#include "onboard/ipc/ipc.hpp"
#include "onboard/link/core/link_core.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "onboard/link/shell/publisher_thread.hpp"
#include "onboard/link/shell/transport/link_ends.hpp"

namespace ledgerline::link {

/// Counts of the loop; read after it ended.
struct LoopMetrics {
  std::uint64_t cycles = 0;
  std::uint64_t overruns = 0;  ///< cycles that began more than a period late
  Histogram lateness;          ///< of each cycle's begin
  std::uint64_t sends_failed = 0;
  std::uint64_t trace_lost = 0;  ///< the writer was behind
};

/// The loop's trace, on its way to the thread that writes it. All but records(): the loop's thread; wait-free.
class LoopTrace {
 public:
  using Ring = SpscRing<TraceRecord, 16384>;

  void add(const TraceRecord& record) noexcept { lost_ += ring_.push(record) ? 0 : 1; }
  void add_turn(TimeNs due_ns, TimeNs begun_ns) noexcept {
    if (turns_.add(due_ns, begun_ns)) add(turns_.record());
  }
  /// Of the turns since the last full record; behind the last turn.
  void finish() noexcept {
    if (turns_.record().extra < PackedTurns::capacity) add(turns_.record());
  }
  /// A drone is sent something: what it was sent before is forgotten.
  void begin_sending(DroneNumber drone) noexcept { newest_sent_[drone] = {}; }
  /// That carried the setpoint of this command_applied.
  void add_sent(TraceRecord applied, TimeNs sent_ns) noexcept;
  /// The network device had it.
  void add_left(const Transport::AtDevice& left) noexcept;

  std::uint64_t lost() const noexcept { return lost_; }
  /// The writer's end: one thread.
  Ring& records() noexcept { return ring_; }

 private:
  Ring ring_;
  PackedTurns turns_;
  std::array<TraceRecord, max_drones + 1> newest_sent_{};  ///< by drone: of its newest datagram, if with a setpoint
  std::uint64_t lost_ = 0;                                 ///< the writer was behind
};

/// The one real-time loop: time-triggered, each turn polls shared memory and transport, steps the core, sends. Its only
/// system calls are clock, sleep, non-blocking receive and send (through the shim: clock and sleep alone); it takes no
/// lock, allocates nothing and throws nothing (tests/unit/onboard/link/shell/real_link_test.cpp watches it). What
/// others want to see leaves through wait-free rings.
class LinkLoop {
 public:
  /// `stop`: see run(). Any thread sets it, or a signal's handler.
  LinkLoop(const ShellSettings& settings, LinkCore& core, ipc::LinkEnd& end, PublisherThread& publisher,
           Transport& transport, const std::atomic<bool>& stop)
      : stop_(stop),
        settings_(settings),
        core_(core),
        end_(end),
        publisher_(publisher),
        transport_(transport),
        local_stops_(bits(core.local_stops())) {}

  /// Runs in the calling thread until `stop` is set, and then until all drones are on the ground or were commanded to
  /// land long enough, or the bound is over; or until the clock is lost.
  void run(LoopClock& clock) noexcept;

  /// Any thread: somebody at this host clears the local stops.
  void clear_local_stops() noexcept { clear_local_stops_.store(true, std::memory_order_relaxed); }
  /// Any thread: the drones that the local stop key keeps down, as of the newest turn.
  DroneSet local_stops() const noexcept { return DroneSet(local_stops_.load(std::memory_order_relaxed)); }
  bool ended() const noexcept { return ended_.load(std::memory_order_acquire); }
  /// How many turns were made: the proof that the loop goes on.
  std::uint64_t turns() const noexcept { return turns_.load(std::memory_order_relaxed); }

  /// The other thread's ends of the rings: one thread.
  LoopTrace::Ring& trace() noexcept { return trace_.records(); }
  SpscRing<StateSample, 512>& states() noexcept { return states_; }
  SpscRing<SerialReport, 64>& serials() noexcept { return serials_; }
  SpscRing<DroneWords, 64>& words() noexcept { return words_; }

  /// After ended().
  const LoopMetrics& metrics() const noexcept { return metrics_; }

 private:
  static std::uint32_t bits(const DroneSet& drones) noexcept {
    static_assert(max_drones < 32);
    return static_cast<std::uint32_t>(drones.to_ulong());
  }
  void turn(const LoopClock& clock, TimeNs now, bool stopping) noexcept;

  const std::atomic<bool>& stop_;
  const ShellSettings& settings_;
  LinkCore& core_;
  ipc::LinkEnd& end_;
  PublisherThread& publisher_;
  Transport& transport_;
  std::array<Plan, 64> plans_{};
  std::array<Pose, 128> poses_{};
  std::array<AgentHeartbeat, 32> heartbeats_{};  ///< as ipc's queue holds
  LoopTrace trace_;
  SpscRing<StateSample, 512> states_;
  SpscRing<SerialReport, 64> serials_;
  SpscRing<DroneWords, 64> words_;
  LoopMetrics metrics_;
  bool check_reported_ = false;
  std::atomic<bool> clear_local_stops_{false};
  std::atomic<std::uint32_t> local_stops_;
  std::atomic<bool> ended_{false};
  std::atomic<std::uint64_t> turns_{0};
};

}  // namespace ledgerline::link
