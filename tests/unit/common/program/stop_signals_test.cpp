#include "common/program/program.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace ledgerline {
namespace {

TEST(StopSignals, TwoWithinAMomentAreOneRequestAndALaterOneIsASecond) {
  stop_requests = 0;
  stop_requested = false;
  last_stop_request_ms = -1;
  catch_stop_signals({SIGINT});
  std::raise(SIGINT);
  std::raise(SIGINT);
  EXPECT_TRUE(stop_requested);
  EXPECT_EQ(stop_requests, 1);
  std::this_thread::sleep_for(std::chrono::milliseconds(250));
  std::raise(SIGINT);
  EXPECT_EQ(stop_requests, 2);
  std::signal(SIGINT, SIG_DFL);
}

}  // namespace
}  // namespace ledgerline
