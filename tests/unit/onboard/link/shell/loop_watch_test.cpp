#include <gtest/gtest.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdlib>

#include "common/base/file.hpp"

/// The watch itself: each rule broken by loop_offender must show, and nothing else. Arguments: loop_watch,
/// loop_offender.
namespace ledgerline {
namespace {

std::string watch, offender;

std::string report_of(const std::string& rule, const std::string& settings = "") {
  const std::string file = ::testing::TempDir() + "loop_watch_test_" + std::to_string(::getpid());
  const std::string command = "LD_PRELOAD=" + watch + " LOOP_WATCH_REPORT=" + file + " " + settings + " " + offender +
                              " '" + rule + "'" + (settings.starts_with("LOOP_WATCH_LOCKS") ? " polls" : "");
  EXPECT_EQ(std::system(command.c_str()), 0) << command;
  const auto report = read_file(file);
  EXPECT_TRUE(report);
  ::unlink(file.c_str());
  return report ? *report : "";
}

TEST(LoopWatch, ALoopThatKeepsTheRulesIsClean) { EXPECT_EQ(report_of("none"), "turns 5\n"); }

TEST(LoopWatch, EveryBrokenRuleShows) {
  const auto call = [](long number) { return "system call " + std::to_string(number); };
  const std::pair<const char*, std::string> rules[] = {
      {"malloc", "malloc"},
      {"calloc", "calloc"},
      {"realloc", "realloc"},
      {"free", "free"},
      {"aligned_alloc", "aligned_alloc"},
      {"posix_memalign", "posix_memalign"},
      {"new", "malloc"},
      {"aligned new", "aligned_alloc"},
      {"mutex", "pthread_mutex_lock"},
      {"trylock", "pthread_mutex_trylock"},
      {"condition", "pthread_cond_signal"},
      {"rwlock", "pthread_rwlock_rdlock"},
      {"throw", "__cxa_throw"},
      {"write", call(SYS_write)},
      {"waiting receive", call(SYS_recvfrom)},
      {"system call", call(SYS_getppid)},
  };
  for (const auto& [rule, shown] : rules) {
    // Of five turns four are followed by another.
    const std::string report = report_of(rule);
    EXPECT_NE(report.find("\n" + shown + ": 4 x"), std::string::npos) << rule << ":\n" << report;
  }
}

TEST(LoopWatch, OverTheShimClockAndSleepAloneAreAllowed) {
  const std::string shim = "LOOP_WATCH_SHIM=1";
  EXPECT_EQ(report_of("clock", shim), "turns 5\n");
  for (const auto& [rule, number] :
       {std::pair("none", SYS_sendto), std::pair("none", SYS_recvfrom), std::pair("wake", SYS_sendto)}) {
    const std::string report = report_of(rule, shim);
    EXPECT_NE(report.find("\nsystem call " + std::to_string(number) + ": 4 x"), std::string::npos) << report;
  }
  EXPECT_NE(report_of("malloc", shim).find("\nmalloc: 4 x"), std::string::npos);
}

TEST(LoopWatch, WhereOnlyLocksAreWatchedTheyShowWithTheirPlaceAndNothingElseDoes) {
  const std::string only = "LOOP_WATCH_LOCKS=loop_offender";
  for (const char* rule : {"none", "malloc", "new", "throw", "write", "system call"})
    EXPECT_EQ(report_of(rule, only), "turns 5\n") << rule;
  for (const auto& [rule, shown] :
       {std::pair("mutex", "pthread_mutex_lock"), std::pair("trylock", "pthread_mutex_trylock"),
        std::pair("condition", "pthread_cond_signal"), std::pair("rwlock", "pthread_rwlock_rdlock")}) {
    const std::string report = report_of(rule, only);
    EXPECT_NE(report.find(std::string("\n") + shown + ": 4 x, by " + offender + "+0x"), std::string::npos) << report;
  }
}

}  // namespace
}  // namespace ledgerline

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  if (argc < 3) return 2;
  ledgerline::watch = argv[1];
  ledgerline::offender = argv[2];
  return RUN_ALL_TESTS();
}
