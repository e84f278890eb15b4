#include "common/program/program.hpp"

#include <cstdio>

#include "common/base/log.hpp"

namespace ledgerline {

std::string version_line(const std::string& program) {
  return (program.empty() ? "ledgerline" : "ledgerline-" + program) + " " + LEDGERLINE_VERSION;
}

int fail(const Error& error, int exit_code) {
  spdlog::error("{}", error.what);
  return exit_code;
}

int exit_code(const Status& ended) { return ended ? 0 : fail(ended.error()); }

int exit_code(const Result<bool>& ended) {
  if (!ended) return fail(ended.error());
  return *ended ? 0 : exit_failed;
}

void print_line(const std::string& line) {
  std::printf("%s\n", line.c_str());
  std::fflush(stdout);
}

}  // namespace ledgerline
