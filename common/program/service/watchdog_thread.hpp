#pragma once
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>

#include "common/program/service/service_manager.hpp"

namespace ledgerline {

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
