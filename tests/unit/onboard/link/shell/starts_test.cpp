#include "onboard/link/shell/persistent_state.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>

namespace ledgerline::link {
namespace {

class Starts : public ::testing::Test {
 protected:
  ~Starts() override { ::unlink(file.c_str()); }
  int noted(TimeNs now) {
    const auto count = record_start(file, now);
    EXPECT_TRUE(count) << count.error().message;
    return count ? *count : 0;
  }
  const std::string file = ::testing::TempDir() + "starts_test_" + std::to_string(::getpid());
};

TEST_F(Starts, AreCountedForFifteenSeconds) {
  for (int i = 1; i <= 7; ++i) EXPECT_EQ(noted(100 * ns_per_s + i * ns_per_s), i);
  EXPECT_EQ(noted(102 * ns_per_s + starts_within_ns), 7) << "the first is forgotten";
  EXPECT_EQ(noted(200 * ns_per_s), 1);
  struct stat is {};
  ASSERT_EQ(::stat(file.c_str(), &is), 0);
  EXPECT_EQ(is.st_mode & 0777, 0600U);
}

TEST_F(Starts, MoreThanItHoldsAreStillMany) {
  for (int i = 1; i <= 200; ++i) EXPECT_EQ(noted(100 * ns_per_s + i * ns_per_ms), std::min(i, 64));
}

TEST_F(Starts, OfAnEarlierBootOrAnotherProgramCountNothing) {
  EXPECT_EQ(noted(5000 * ns_per_s), 1);
  EXPECT_EQ(noted(ns_per_s), 1) << "the clock restarted";
  std::ofstream(file) << "torn";
  EXPECT_EQ(noted(2 * ns_per_s), 1);
  std::ofstream(file) << std::string(512, '\xff');
  EXPECT_EQ(noted(3 * ns_per_s), 1);
}

TEST_F(Starts, AFileThatCannotBeWrittenIsAnErrorThatNamesIt) {
  const auto count = record_start("/nowhere/starts", ns_per_s);
  ASSERT_FALSE(count);
  EXPECT_NE(count.error().message.find("/nowhere/starts"), std::string::npos);
}

}  // namespace
}  // namespace ledgerline::link
