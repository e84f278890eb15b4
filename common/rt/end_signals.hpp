#pragma once
#include <atomic>
#include <csignal>
#include <initializer_list>

namespace ledgerline {

/// Whether this program has been asked to end, and how often, once catch_end_signals() was called.
inline std::atomic<bool> end_asked{false};
inline std::atomic<int> ends_asked{0};
static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free);

/// Of SIGINT and SIGTERM, or of those named. Calls that wait are interrupted. Before threads begin.
inline void catch_end_signals(std::initializer_list<int> signals = {SIGINT, SIGTERM}) {
  struct sigaction action {};
  action.sa_handler = [](int) {
    ++ends_asked;
    end_asked = true;
  };
  for (const int signal : signals) ::sigaction(signal, &action, nullptr);
}

/// The same, but signals come in only while a loop waits with the mask that this returns (ppoll, pselect), so that none
/// is missed between a look at end_asked and the next wait.
inline sigset_t catch_end_signals_while_waiting() {
  catch_end_signals();
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
