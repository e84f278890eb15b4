#pragma once
#include <atomic>
#include <csignal>
#include <cstdint>
#include <ctime>
#include <initializer_list>

namespace ledgerline {

/// Set and counted by the signals that catch_stop_signals() catches: the program shall end. Two within 200 ms are one
/// request: a wrapper (ros2 launch, npm, timeout) and the terminal pass on the same Ctrl-C. A person needs longer.
inline std::atomic<bool> stop_requested{false};
inline std::atomic<int> stop_requests{0};
inline std::atomic<std::int64_t> last_stop_request_ms{-1};
static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free &&
              std::atomic<std::int64_t>::is_always_lock_free);

inline void on_stop_signal(int) {
  constexpr std::int64_t one_request_ms = 200;
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  const std::int64_t now_ms = std::int64_t{now.tv_sec} * 1000 + now.tv_nsec / 1'000'000;
  const std::int64_t last_ms = last_stop_request_ms.exchange(now_ms);
  if (last_ms < 0 || now_ms - last_ms >= one_request_ms) ++stop_requests;
  stop_requested = true;
}

/// Catches SIGINT and SIGTERM, or those named; calls that wait are interrupted. To be called before any thread starts.
inline void catch_stop_signals(std::initializer_list<int> signals = {SIGINT, SIGTERM}) {
  struct sigaction action {};
  action.sa_handler = on_stop_signal;
  for (const int signal : signals) ::sigaction(signal, &action, nullptr);
}

/// catch_stop_signals() for a program that runs until it is asked to end. When its terminal is closed it ends in its
/// own way, too, unless it was started to outlive that (nohup).
inline void catch_stop_signals_of_service() {
  catch_stop_signals();
  struct sigaction hangup {};
  ::sigaction(SIGHUP, nullptr, &hangup);
  if (hangup.sa_handler != SIG_IGN) catch_stop_signals({SIGHUP});
}

/// Blocks these signals in this thread and those that it starts, so that sigwait() alone sees them; returns them.
inline sigset_t block_signals(std::initializer_list<int> signals = {SIGINT, SIGTERM}) {
  sigset_t blocked;
  sigemptyset(&blocked);
  for (const int signal : signals) sigaddset(&blocked, signal);
  pthread_sigmask(SIG_BLOCK, &blocked, nullptr);
  return blocked;
}

/// catch_stop_signals() for a loop that waits in ppoll or pselect: signals are blocked but while it waits with the mask
/// that this returns, so none can be missed between its look at stop_requested and the wait.
inline sigset_t catch_stop_signals_while_waiting() {
  catch_stop_signals();
  sigset_t blocked, before;
  sigemptyset(&blocked);
  sigaddset(&blocked, SIGINT);
  sigaddset(&blocked, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &blocked, &before);
  sigdelset(&before, SIGINT);
  sigdelset(&before, SIGTERM);
  return before;
}

}  // namespace ledgerline
