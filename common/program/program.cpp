#include "common/program/program.hpp"

#include <poll.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>

#include "common/base/log.hpp"

namespace ledgerline {

std::string version_line(const std::string& program) {
  return (program.empty() ? "ledgerline" : "ledgerline-" + program) + " " + LEDGERLINE_VERSION;
}

int fail(const Error& error, int exit_code) {
  spdlog::error("{}", error.message);
  return exit_code;
}

int exit_code(const Status& ended) { return ended ? 0 : fail(ended.error()); }

int exit_code(const Result<bool>& ended) {
  if (!ended) return fail(ended.error());
  return *ended ? 0 : exit_failed;
}

void outlive_readers() {
  std::signal(SIGPIPE, SIG_IGN);
  log_without_waiting();
}

void print_line(const std::string& line) {
  std::printf("%s\n", line.c_str());
  std::fflush(stdout);
}

void print_status(const std::string& line) {
  pollfd output{STDOUT_FILENO, POLLOUT, 0};
  // An error, as of a reader who is gone, is not waited for, either.
  if (::poll(&output, 1, 0) == 1) print_line(line);
}

}  // namespace ledgerline
