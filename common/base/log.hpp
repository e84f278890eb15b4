#pragma once
#include <spdlog/sinks/sink.h>
#include <spdlog/spdlog.h>

#include <cstddef>
#include <memory>
#include <string>

namespace ledgerline {

/// One logger for every program: to standard error, with time, level and the program's name. Standard output is for
/// results. Level from LEDGERLINE_LOG (trace, debug, info, warn, error), else `info`.
void init_log(const std::string& program);

/// Behind init_log(), for a program that runs until it is asked to end: from now on no thread waits for who reads the
/// log (LogRing). A process that leaves by _exit() calls spdlog::default_logger()->flush() before, and one
/// that forks does so before this call.
void log_without_waiting();

/// Log lines on their way to a descriptor. A thread of its own writes them, so a thread that logs never waits for a
/// reader that stands still, nor for a disk. Bounded: a full ring drops lines until it is empty again, and then writes
/// how many, in the place of the gap.
///
/// Threads: any may log; each holds a mutex for the time of formatting one line, the writer never while it writes.
class LogRing final : public spdlog::sinks::sink {
 public:
  /// Some 10,000 lines. Half loses lines of a start with 16 drones behind a slow terminal; double is memory that a
  /// reader who stands still takes from a small computer.
  static constexpr std::size_t default_bytes = 1 << 20;

  /// `fd` stays open as long as the process lives.
  explicit LogRing(int fd, std::size_t max_bytes = default_bytes);
  /// As flush(); what is left then is lost.
  ~LogRing() override;
  LogRing(const LogRing&) = delete;
  LogRing& operator=(const LogRing&) = delete;

  void log(const spdlog::details::log_msg& message) override;
  /// Until everything is written, for a second at most: no reader keeps a program from ending.
  void flush() override;
  void set_pattern(const std::string& pattern) override;
  void set_formatter(std::unique_ptr<spdlog::formatter> formatter) override;

 private:
  struct Lines;
  std::shared_ptr<Lines> lines_;  ///< the writer's, too: it may wait in a write when this ends
};

}  // namespace ledgerline
