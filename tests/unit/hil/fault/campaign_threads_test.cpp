#include <gtest/gtest.h>

#include <map>
#include <string>

#include "hil/fault/run/run.hpp"

namespace ledgerline::hil {
namespace {

// Short ones: a stop in the climb, with and without a fault before it.
std::map<std::size_t, crypto::Digest> digests(unsigned jobs) {
  constexpr std::size_t count = 4;
  std::map<std::size_t, crypto::Digest> all;
  fly_all(
      count, jobs,
      [](std::size_t i) {
        std::string toml = "title = \"t\"\n[[fault]]\nwhat = \"operator stop tello1\"\nat = \"height 0.5\"\n";
        if (i % 2 == 1) toml += "[[fault]]\nwhat = \"drone tello1 to loss 10%, jitter 5ms\"\nat = \"takeoff\"\n";
        auto script = parse_script(toml, "x.toml");
        EXPECT_TRUE(script.ok()) << script.error().message;
        return Flight{*script, i + 1};
      },
      [&](std::size_t i, const Flight&, Result<RunResult> result) {
        EXPECT_TRUE(result.ok());
        if (result) all[i] = result->digest;
        return true;
      });
  EXPECT_EQ(all.size(), count);
  return all;
}

TEST(FaultThreads, FlightsInTwoThreadsGiveTheBytesOfFlightsInOne) {
  const auto one = digests(1);
  EXPECT_EQ(digests(2), one);
  EXPECT_NE(one.at(0), one.at(2));
}

}  // namespace
}  // namespace ledgerline::hil
