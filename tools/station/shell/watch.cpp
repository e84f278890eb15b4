#include "tools/station/shell/options.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <ctime>
#include <thread>

#include "common/program/program.hpp"

namespace ledgerline::station {

void print_refreshed(const std::string& text) {
  fmt::print("{}{}", ::isatty(STDOUT_FILENO) == 1 ? "\x1b[H\x1b[J" : "", text);
  std::fflush(stdout);
}

void rest(TimeNs duration_ns) {
  for (const TimeNs until_ns = monotonic_ns() + duration_ns; !stop_requested && monotonic_ns() < until_ns;)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
}

std::string time_of_day(double t_ms, double now_ms) {
  const auto at = static_cast<std::time_t>((static_cast<double>(realtime_ns()) / 1e6 - (now_ms - t_ms)) / 1e3);
  std::tm local{};
  localtime_r(&at, &local);
  char text[16];
  std::strftime(text, sizeof text, "%H:%M:%S", &local);
  return text;
}

}  // namespace ledgerline::station
