#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "ground/service/shell/hub.hpp"

namespace ledgerline::ground::service {
namespace {

nlohmann::json reported(const Greeting& greeting) {
  return nlohmann::json::parse(Hub({"tello1"}, greeting, {}, ns_per_s).greeting());
}

TEST(Greeting, SaysHowItIsFlown) {
  const auto hello = reported({.manual = true, .speed_mps = 0.5, .cmd_timeout_ns = 500 * ns_per_ms});
  EXPECT_EQ(hello["op"], "hello");
  EXPECT_GT(hello["started_ms"], 0);
  EXPECT_EQ(hello["manual"], true);
  EXPECT_EQ(hello["speed_mps"], 0.5);
  EXPECT_EQ(hello["cmd_timeout_ms"], 500);
}

TEST(Greeting, SaysTheFenceOrThatNoneIsKnown) {
  EXPECT_EQ(reported({.fence = mission::Fence{.min_m = {-5, -4.25, 0}, .max_m = {5, 4, 2.5}}})["fence"],
            nlohmann::json::parse(R"({"min_m":[-5,-4.25,0],"max_m":[5,4,2.5]})"));
  EXPECT_TRUE(reported({}).at("fence").is_null());
}

}  // namespace
}  // namespace ledgerline::ground::service
