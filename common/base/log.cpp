#include "common/base/log.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <pthread.h>
#include <spdlog/cfg/helpers.h>
#include <spdlog/details/log_msg.h>
#include <spdlog/details/os.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <deque>
#include <mutex>
#include <string_view>
#include <thread>
#include <utility>

namespace ledgerline {
namespace {

void use(const std::shared_ptr<spdlog::logger>& logger) {
  spdlog::set_default_logger(logger);
  spdlog::set_pattern("%H:%M:%S.%e %^%l%$ %n: %v");
  const char* level = std::getenv("LEDGERLINE_LOG");
  spdlog::set_level(level ? spdlog::level::from_str(level) : spdlog::level::info);
}

constexpr std::chrono::seconds max_flush{1};

// A reader that is gone takes the rest of the line with it.
void write_all(int fd, std::string_view text) {
  while (!text.empty()) {
    const ssize_t written = ::write(fd, text.data(), text.size());
    if (written >= 0) {
      text.remove_prefix(static_cast<std::size_t>(written));
    } else if (errno == EAGAIN) {  // somebody who shares the descriptor made it non-blocking
      pollfd writable{fd, POLLOUT, 0};
      (void)::poll(&writable, 1, -1);
    } else if (errno != EINTR) {
      return;
    }
  }
}

std::string_view colour(spdlog::level::level_enum level) {
  switch (level) {
    case spdlog::level::info:
      return "\033[32m";
    case spdlog::level::warn:
      return "\033[33m\033[1m";
    case spdlog::level::err:
    case spdlog::level::critical:
      return "\033[31m\033[1m";
    default:
      return "\033[36m";
  }
}

}  // namespace

void init_log(const std::string& program) {
  use(spdlog::stderr_color_mt(program));
  spdlog::flush_on(spdlog::level::info);
}

void log_without_waiting() {
  use(std::make_shared<spdlog::logger>(spdlog::default_logger()->name(), std::make_shared<LogRing>(STDERR_FILENO)));
  spdlog::flush_on(spdlog::level::critical);
}

struct LogRing::Lines {
  Lines(int to, std::size_t most)
      : fd(to), max_bytes(most), is_coloured(::isatty(to) != 0 && spdlog::details::os::is_color_terminal()) {}

  // All below are called with the mutex held.
  std::string format(const spdlog::details::log_msg& message) const {
    spdlog::memory_buf_t text;
    formatter->format(message, text);
    std::string line(text.data(), text.size());
    if (is_coloured && message.color_range_end > message.color_range_start) {
      line.insert(message.color_range_end, "\033[m");
      line.insert(message.color_range_start, colour(message.level));
    }
    return line;
  }

  void push(std::string line) {
    bytes += line.size();
    waiting.push_back(std::move(line));
    changed.notify_all();
  }

  void tell_of_dropped() {
    const std::string text = fmt::format("{} lines of the log were dropped here: its reader, or its disk, stood still",
                                         std::exchange(dropped, 0));
    push(format(spdlog::details::log_msg(program, spdlog::level::warn, text)));
  }

  // The writer's thread.
  void write() {
    ::pthread_setname_np(::pthread_self(), "log");
    std::unique_lock lock(mutex);
    while (true) {
      changed.wait(lock, [this] { return !waiting.empty() || is_ending; });
      if (waiting.empty()) return;
      const std::string line = waiting.front();  // it stays there until it is written, for flush()
      lock.unlock();
      write_all(fd, line);
      lock.lock();
      bytes -= line.size();
      waiting.pop_front();
      if (waiting.empty() && dropped > 0) tell_of_dropped();
      if (waiting.empty()) changed.notify_all();
    }
  }

  const int fd;
  const std::size_t max_bytes;
  const bool is_coloured;
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<std::string> waiting;
  std::size_t bytes = 0;      ///< in `waiting`
  std::uint64_t dropped = 0;  ///< since it was full; above 0 everything is dropped until `waiting` is empty
  std::string program;        ///< the name of the logger that was dropped
  bool is_ending = false;
  std::unique_ptr<spdlog::formatter> formatter = std::make_unique<spdlog::pattern_formatter>();
};

LogRing::LogRing(int fd, std::size_t max_bytes) : lines_(std::make_shared<Lines>(fd, max_bytes)) {
  // The program's signals are for its own threads.
  sigset_t all, before;
  sigfillset(&all);
  ::pthread_sigmask(SIG_SETMASK, &all, &before);
  std::thread([lines = lines_] { lines->write(); }).detach();
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

LogRing::~LogRing() {
  flush();
  const std::lock_guard lock(lines_->mutex);
  lines_->is_ending = true;
  lines_->changed.notify_all();
}

void LogRing::log(const spdlog::details::log_msg& message) {
  const std::lock_guard lock(lines_->mutex);
  std::string line = lines_->format(message);
  const bool has_room = lines_->waiting.empty() || lines_->bytes + line.size() <= lines_->max_bytes;
  if (lines_->dropped == 0 && has_room) return lines_->push(std::move(line));
  if (lines_->dropped++ == 0) lines_->program.assign(message.logger_name.data(), message.logger_name.size());
}

void LogRing::flush() {
  std::unique_lock lock(lines_->mutex);
  lines_->changed.wait_for(lock, max_flush, [this] { return lines_->waiting.empty(); });
}

void LogRing::set_pattern(const std::string& pattern) {
  set_formatter(std::make_unique<spdlog::pattern_formatter>(pattern));
}

void LogRing::set_formatter(std::unique_ptr<spdlog::formatter> formatter) {
  const std::lock_guard lock(lines_->mutex);
  lines_->formatter = std::move(formatter);
}

}  // namespace ledgerline
