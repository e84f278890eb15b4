#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <fstream>
#include <functional>
#include <string>

#include "common/base/log.hpp"
#include "common/config/config.hpp"
#include "common/program/program.hpp"

namespace ledgerline {
namespace {

/// How such a program ends, as waitpid gives it, when nobody reads what it prints and logs.
int run_unread(const std::function<int(Config&)>& run) {
  const pid_t child = ::fork();
  if (child == 0) {
    std::array<int, 2> output{};
    std::signal(SIGPIPE, SIG_DFL);
    if (::pipe2(output.data(), O_CLOEXEC) != 0) ::_exit(127);
    ::dup2(output[1], STDOUT_FILENO);
    ::dup2(output[1], STDERR_FILENO);
    ::close(output[0]);
    const std::string file = ::testing::TempDir() + "config_program_test_" + std::to_string(::getpid());
    std::ofstream(file).close();
    std::array<std::string, 3> words{"ledgerline-unread", "--config", file};
    std::array<char*, 3> arguments{words[0].data(), words[1].data(), words[2].data()};
    const int code =
        run_with_config(static_cast<int>(arguments.size()), arguments.data(), {"unread", "about", "notes"}, run);
    ::unlink(file.c_str());
    ::_exit(code);
  }
  int status = -1;
  ::waitpid(child, &status, 0);
  return status;
}

TEST(ConfigProgram, GoesOnThoughNobodyReadsItsOutputAnyMore) {
  constexpr std::size_t beyond_any_buffer = 100'000;
  const int status = run_unread([](Config&) {
    print_line("short");
    print_line(std::string(beyond_any_buffer, 'x'));
    spdlog::error("words");
    return 7;
  });
  ASSERT_TRUE(WIFEXITED(status)) << "by signal " << WTERMSIG(status);
  EXPECT_EQ(WEXITSTATUS(status), 7);
}

TEST(PrintStatus, WaitsForNoReaderWhoStandsStillAndGoesOnWithHim) {
  const pid_t child = ::fork();
  if (child == 0) {
    std::array<int, 2> output{};
    std::array<char, 4096> read{};
    if (::pipe2(output.data(), O_CLOEXEC) != 0) ::_exit(127);
    ::dup2(output[1], STDOUT_FILENO);
    ::alarm(10);
    for (int i = 0; i < 1'000; ++i) print_status(std::string(1'000, 'x'));  // a pipe takes 65,536 bytes
    std::string all;
    while (all.size() < 20'000) all.append(read.data(), static_cast<std::size_t>(::read(output[0], read.data(), 4096)));
    print_status("the newest");
    ::close(output[1]);
    ::close(STDOUT_FILENO);
    for (ssize_t n; (n = ::read(output[0], read.data(), read.size())) > 0;)
      all.append(read.data(), static_cast<std::size_t>(n));
    ::_exit(all.ends_with("x\nthe newest\n") ? 0 : 1);
  }
  int status = -1;
  ::waitpid(child, &status, 0);
  ASSERT_TRUE(WIFEXITED(status)) << "by signal " << WTERMSIG(status);
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

}  // namespace
}  // namespace ledgerline
