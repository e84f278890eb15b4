#include "common/base/log.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <array>
#include <string>

namespace ledgerline {
namespace {

/// A log whose reader is this test, by a pipe.
class LogRingTest : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(::pipe2(pipe_.data(), O_CLOEXEC), 0);
    ring_ = std::make_shared<LogRing>(pipe_[1], max_bytes);
    logger_ = std::make_shared<spdlog::logger>("link", ring_);
    logger_->set_pattern("%l %n: %v");
  }
  ~LogRingTest() override {
    ::close(pipe_[0]);  // a writer that still waits is let go
    logger_.reset();
    ring_.reset();
  }
  /// From here on a write waits.
  void fill_pipe() {
    ::fcntl(pipe_[1], F_SETFL, O_NONBLOCK);
    while (::write(pipe_[1], "", 1) == 1) ++filled_;
    ::fcntl(pipe_[1], F_SETFL, 0);
  }
  /// What was logged, up to a text; what filled the pipe before is left out.
  std::string read_until(const std::string& end) {
    std::string text;
    std::array<char, 4096> part{};
    while (text.find(end) == std::string::npos) {
      const ssize_t count = ::read(pipe_[0], part.data(), part.size());
      if (count <= 0) return text + "<end>";
      for (ssize_t i = 0; i < count; ++i) {
        if (part[static_cast<std::size_t>(i)] != '\0') text += part[static_cast<std::size_t>(i)];
      }
    }
    return text;
  }

  static constexpr std::size_t max_bytes = 64 * 21;  // lines of 21 bytes
  std::array<int, 2> pipe_{-1, -1};
  std::shared_ptr<LogRing> ring_;
  std::shared_ptr<spdlog::logger> logger_;
  std::size_t filled_ = 0;
};

TEST_F(LogRingTest, WritesWhatIsLoggedInItsOrder) {
  logger_->info("one");
  logger_->error("two");
  EXPECT_EQ(read_until("two\n"), "info link: one\nerror link: two\n");
}

// Before there was a ring this test would not end.
TEST_F(LogRingTest, AReaderThatStandsStillKeepsNobodyFromLoggingAndLearnsWhatItMissed) {
  fill_pipe();
  for (int i = 0; i < 1'000; ++i) logger_->info("line {:04}", i);  // 21 bytes each
  const std::string text = read_until("stood still\n");
  const auto kept = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n')) - 1;
  EXPECT_EQ(kept, 64U);
  EXPECT_NE(text.find("info link: line 0000\n"), std::string::npos);
  EXPECT_NE(text.find("info link: line 0063\nwarning link: 936 lines of the log were dropped here"), std::string::npos)
      << text;
  logger_->info("again");
  EXPECT_EQ(read_until("again\n"), "info link: again\n");
}

TEST_F(LogRingTest, AReaderThatStandsStillKeepsNoProgramFromEnding) {
  fill_pipe();
  logger_->info("unread");
  logger_.reset();
  ring_.reset();
}

TEST_F(LogRingTest, ALineLongerThanTheRingIsWrittenNevertheless) {
  logger_->info("{}", std::string(2 * max_bytes, 'x'));
  EXPECT_NE(read_until("x\n").find(std::string(2 * max_bytes, 'x')), std::string::npos);
}

TEST_F(LogRingTest, FlushedItIsWrittenWholly) {
  for (int i = 0; i < 50; ++i) logger_->info("line {:04}", i);
  logger_->flush();
  ::fcntl(pipe_[0], F_SETFL, O_NONBLOCK);
  EXPECT_NE(read_until("line 0049\n").find("line 0000"), std::string::npos);
}

}  // namespace
}  // namespace ledgerline
