#include "common/program/service/watchdog_thread.hpp"

#include <pthread.h>

#include <chrono>
#include <csignal>
#include <utility>

#include "common/rt/real_time.hpp"

namespace ledgerline {
namespace {

// A datagram goes out each half of the manager's timeout. Halved this wakes the thread oftener for nothing, doubled a
// datagram may be late by a tenth of the timeout.
constexpr int looks_per_timeout = 20;

}  // namespace

WatchdogThread::WatchdogThread(ServiceManager& manager, std::function<std::uint64_t()> progress, int priority)
    : manager_(manager), progress_(std::move(progress)) {
  if (manager.timeout_ns() == 0) return;
  // The program's signals are for its own threads.
  sigset_t all, before;
  sigfillset(&all);
  ::pthread_sigmask(SIG_SETMASK, &all, &before);
  thread_ = std::thread([this, priority] {
    ::pthread_setname_np(::pthread_self(), "watchdog");
    if (priority > 0) (void)schedule_fifo(priority);
    run(manager_.timeout_ns() / looks_per_timeout);
  });
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

WatchdogThread::~WatchdogThread() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    is_ending_ = true;
  }
  ending_.notify_all();
  thread_.join();
}

void WatchdogThread::run(TimeNs look_ns) {
  std::unique_lock lock(mutex_);
  while (!ending_.wait_for(lock, std::chrono::nanoseconds(look_ns), [this] { return is_ending_; })) {
    if (!manager_.alive(monotonic_ns(), progress_())) failed_.fetch_add(1, std::memory_order_relaxed);
  }
}

}  // namespace ledgerline
