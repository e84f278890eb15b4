#pragma once
#include <unistd.h>

#include <cstdio>

namespace ledgerline::ipc {

/// iceoryx writes banners to standard output, which is for results here: while this lives, they go to standard error.
/// Before other threads write.
class QuietStdout {
 public:
  QuietStdout() : saved_(::dup(STDOUT_FILENO)) {
    std::fflush(stdout);
    ::dup2(STDERR_FILENO, STDOUT_FILENO);
  }
  QuietStdout(const QuietStdout&) = delete;
  QuietStdout& operator=(const QuietStdout&) = delete;
  ~QuietStdout() {
    std::fflush(stdout);
    ::dup2(saved_, STDOUT_FILENO);
    ::close(saved_);
  }

 private:
  int saved_;
};

}  // namespace ledgerline::ipc
