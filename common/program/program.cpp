#include "common/program/program.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <iostream>
#include <system_error>
#include <utility>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/config/config.hpp"
#include "common/program/command_line.hpp"

namespace ledgerline {

std::string version_line(const std::string& program) { return program + " " + LEDGERLINE_VERSION; }

std::filesystem::path build_or_prefix() {
  std::error_code error;  // gone: relative paths fail where they are used
  const std::filesystem::path folder = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  return folder.filename() == "ledgerline" ? folder.parent_path().parent_path() : folder.parent_path();
}

std::filesystem::path programs_directory() {
  const char* other = std::getenv("LEDGERLINE_BIN");
  return other ? std::filesystem::path(other) : build_or_prefix() / "bin";
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

void report_uncaught_file_errors() {
  static const std::terminate_handler before = std::get_terminate();  // once: a second call is not to be its own
  std::set_terminate([] {
    try {
      if (const auto thrown = std::current_exception()) std::rethrow_exception(thrown);
    } catch (const std::filesystem::filesystem_error& error) {
      const std::string path = error.path1().empty() ? "the working folder" : error.path1().string();
      std::fprintf(stderr, "error: %s: %s\n", path.c_str(), error.code().message().c_str());
      std::_Exit(exit_failed);
    } catch (const std::system_error& error) {  // fmt's, of an output that takes no more
      std::fprintf(stderr, "error: %s\n", error.what());
      std::_Exit(exit_failed);
    } catch (...) {  // anything else ends as without this
    }
    before();
  });
}

namespace {
bool output_counts = false;
}  // namespace

void report_lost_output() {
  if (std::exchange(output_counts, true)) return;
  std::atexit([] {
    if (!output_counts || (std::ferror(stdout) == 0 && std::fflush(stdout) == 0)) return;
    std::fputs("error: standard output took less than the whole: no room, or nobody reads it\n", stderr);
    std::_Exit(exit_failed);
  });
}

void outlive_readers() {
  output_counts = false;
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

int run_with_config(int argc, char** argv, const ConfigProgram& program, const std::function<int(Config&)>& run) {
  CommandLine line(program.name, program.about, program.notes);
  std::string file;
  line.option(config_argument, file, "TOML file").required();
  if (const auto end = line.parse(argc, argv)) return *end;
  catch_stop_signals_of_service();
  outlive_readers();
  auto config = Config::load(file);
  return config ? run(*config) : fail(config.error(), exit_usage);
}

Result<std::string> read_secret(const std::string& file) {
  constexpr off_t max_bytes = 4096;
  const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return Error{fmt::format("cannot open {}: {}", file, std::strerror(errno))};
  std::string text;
  struct stat info {};
  const bool regular = ::fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
  const bool own = is_private(info);
  const bool fits = info.st_size <= max_bytes;
  ssize_t count = -1;
  if (regular && own && fits) {
    keep_memory_private();
    text.resize(static_cast<std::size_t>(info.st_size));
    count = ::read(fd, text.data(), text.size());
  }
  ::close(fd);
  if (!regular) return Error{file + " is no regular file"};
  if (!own) return Error{fmt::format("{} may be read by others than its owner; run: chmod 600 {}", file, file)};
  if (!fits) return Error{fmt::format("{} has more than {} bytes", file, max_bytes)};
  if (count < 0) return Error{"cannot read " + file};
  text.resize(static_cast<std::size_t>(count));
  return text.substr(0, text.find_first_of("\r\n"));
}

Result<std::string> ask_secret(const std::string& prompt) {
  termios before{};
  const bool terminal = ::tcgetattr(STDIN_FILENO, &before) == 0;
  if (terminal) {
    termios without_echo = before;
    without_echo.c_lflag &= ~static_cast<tcflag_t>(ECHO);
    ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &without_echo);
    std::fprintf(stderr, "%s: ", prompt.c_str());
  }
  std::string secret;
  const bool read = static_cast<bool>(std::getline(std::cin, secret));
  if (terminal) {
    ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &before);
    std::fputs("\n", stderr);
  }
  if (!read) return Error{prompt + ": none was given"};
  return secret;
}

Status Recorder::open(const std::string& trace_file) {
  if (trace_file.empty()) return done;
  auto trace = TraceWriter::create(trace_file);
  if (!trace) return trace.error();
  trace_file_ = trace_file;
  trace_ = std::move(trace).value();
  return done;
}

void Recorder::add(std::span<const TraceRecord> records) {
  if (!trace_) return;
  for (const TraceRecord& record : records) trace_->add(record);
}

Status Recorder::end(const std::string& summary_file, const std::function<std::string()>& summary) {
  if (trace_) {
    if (auto status = trace_->flush(); !status) return status;
    if (trace_->dropped() > 0) spdlog::warn("{}: {} records did not fit", trace_file_, trace_->dropped());
  }
  if (summary_file.empty()) return done;
  return write_file(summary_file, summary() + "\n");
}

}  // namespace ledgerline
