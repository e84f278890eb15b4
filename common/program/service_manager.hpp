#pragma once
#include <sys/un.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline {

/// When to notify the service manager that this process lives: each half of the manager's timeout, and only if its work
/// has gone on since the last time. A process that stands still falls silent, and the manager acts.
class WatchdogPace {
 public:
  /// `timeout_ns` 0: nobody watches, never due.
  explicit WatchdogPace(TimeNs timeout_ns) : timeout_ns_(timeout_ns), period_ns_(timeout_ns / 2) {}
  TimeNs timeout_ns() const noexcept { return timeout_ns_; }

  /// True: notify now; the next time is half a timeout from now. `progress`: any count that moves on with the work that
  /// is watched over.
  bool should_notify(TimeNs now, std::uint64_t progress) noexcept {
    if (period_ns_ == 0 || now < next_ns_ || progress == reported_) return false;
    next_ns_ = now + period_ns_;
    reported_ = progress;
    return true;
  }

 private:
  TimeNs timeout_ns_;
  TimeNs period_ns_;
  TimeNs next_ns_ = 0;
  std::uint64_t reported_ = 0;
};

/// What a service of Type=notify sends to systemd: one datagram each to the socket in NOTIFY_SOCKET (sd_notify(3)).
/// Without one, so when started by hand, nothing is sent. Its calls do not block but are system calls: never in a
/// real-time loop. One thread, but for alive(), which may be another's.
class ServiceManager {
 public:
  /// From NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID; an error where they cannot be meant so.
  static Result<ServiceManager> from_environment();
  ServiceManager(ServiceManager&& other) noexcept;
  ServiceManager& operator=(ServiceManager&&) = delete;
  ~ServiceManager();

  /// How long the manager waits for alive(); 0: it does not watch.
  TimeNs timeout_ns() const noexcept { return pace_.timeout_ns(); }

  /// The errors of these two say why a datagram could not be sent.
  Status ready();
  /// To be called far more often than the manager asks for; it sends when WatchdogPace says so.
  Status alive(TimeNs now, std::uint64_t progress);

 private:
  explicit ServiceManager(TimeNs timeout_ns) : pace_(timeout_ns) {}
  Status send(const char* message) const;

  WatchdogPace pace_;
  int fd_ = -1;  // none: there is no manager
  sockaddr_un address_{};
  unsigned address_size_ = 0;
};

/// Feeds the service manager's watchdog from a thread that does nothing else: a count goes in, a datagram goes out. So
/// no disk and no reader of a log can make the manager kill a process whose work goes on.
class WatchdogThread {
 public:
  /// `progress` is called on the new thread: the count that must move on (WatchdogPace). `priority`: SCHED_FIFO; 0, or
  /// where that is not permitted: an ordinary thread. Without a manager that watches there is no thread.
  WatchdogThread(ServiceManager& manager, std::function<std::uint64_t()> progress, int priority);
  ~WatchdogThread();
  WatchdogThread(const WatchdogThread&) = delete;
  WatchdogThread& operator=(const WatchdogThread&) = delete;

  /// Any thread: datagrams that could not be sent.
  std::uint64_t failed() const noexcept { return failed_.load(std::memory_order_relaxed); }

 private:
  void run(TimeNs look_ns);

  ServiceManager& manager_;
  const std::function<std::uint64_t()> progress_;
  std::atomic<std::uint64_t> failed_{0};
  std::mutex mutex_;
  std::condition_variable ending_;
  bool is_ending_ = false;
  std::thread thread_;
};

}  // namespace ledgerline
