#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <thread>

#include "common/base/result.hpp"
#include "common/rt/spsc_ring.hpp"
#include "onboard/ipc/ipc.hpp"

namespace ledgerline::link {

/// Carries states and transitions from the loop to agent, which it wakes, in a thread of its own. To publish, iceoryx
/// 2.0 takes locks in shared memory that RouDi and agent take too; one of them killed while it holds one would stop the
/// loop for ever. Here it stops the publisher, and link flies on, but has to be killed at its end.
class PublisherThread {
 public:
  /// `priority`: of its thread, SCHED_FIFO; 0, or where that is not permitted, an ordinary one. `looks`: it is not
  /// woken, but looks by itself every millisecond, so that the loop makes no system call for it. `end` outlives it.
  static Result<std::unique_ptr<PublisherThread>> start(ipc::LinkEnd& end, int priority, bool looks = false);
  /// Carries what was put before, then ends the thread.
  ~PublisherThread();
  PublisherThread(const PublisherThread&) = delete;
  PublisherThread& operator=(const PublisherThread&) = delete;

  /// The loop's thread only; wait-free. A state that finds no room is lost, and counted; a transition comes again.
  void put(const StateSample& state) noexcept;
  void put(const Transition& transition) noexcept { (void)transitions_.push(transition); }
  /// The loop's thread only, after the last put of a turn: one non-blocking send, or nothing where it looks.
  void wake() noexcept;

  /// Any thread: states that never came to agent, for want of room here or of a chunk there.
  std::uint64_t lost(DroneNumber drone) const noexcept { return lost_[drone].load(std::memory_order_relaxed); }

 private:
  PublisherThread(ipc::LinkEnd& end, int loop_fd, int own_fd, bool looks)
      : end_(end), loop_fd_(loop_fd), own_fd_(own_fd), looks_(looks) {}
  void wait() const noexcept;
  void run() noexcept;
  void count_lost(DroneNumber drone) noexcept { lost_[drone].fetch_add(1, std::memory_order_relaxed); }

  ipc::LinkEnd& end_;
  const int loop_fd_, own_fd_;  ///< a pair of sockets: the loop may send, but not wake by a futex
  const bool looks_;
  SpscRing<StateSample, 512> ring_;
  SpscRing<Transition, 128> transitions_;
  std::array<std::atomic<std::uint64_t>, max_drones + 1> lost_{};
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace ledgerline::link
