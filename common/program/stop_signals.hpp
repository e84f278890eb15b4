#pragma once
#include <atomic>
#include <csignal>
#include <initializer_list>

namespace ledgerline {

/// Set and counted by the signals that catch_stop_signals() catches: the program shall end.
inline std::atomic<bool> stop_requested{false};
inline std::atomic<int> stop_requests{0};
static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free);

/// Catches SIGINT and SIGTERM, or those named; calls that wait are interrupted. To be called before any thread starts.
inline void catch_stop_signals(std::initializer_list<int> signals = {SIGINT, SIGTERM}) {
  struct sigaction action {};
  action.sa_handler = [](int) {
    ++stop_requests;
    stop_requested = true;
  };
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
