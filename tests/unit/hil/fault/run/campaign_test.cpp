#include <gtest/gtest.h>

#include "hil/fault/random_script.hpp"
#include "hil/fault/run/run.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

TEST(FaultSeeds, AScriptFliesWithItsOwnUnlessAskedOtherwise) {
  Script drawn = draw_script(3);
  drawn.seed = 77;
  const auto again = parse_script(text_of(drawn), "x.toml");
  ASSERT_TRUE(again.ok()) << again.error().message;
  const auto seeds_of = [&](std::optional<std::pair<std::uint64_t, std::uint64_t>> asked) {
    std::vector<std::uint64_t> seeds;
    for (const Flight& flight : flights_of({*again, scripted("title = \"t\"\n")}, asked)) seeds.push_back(flight.seed);
    return seeds;
  };
  EXPECT_EQ(seeds_of({}), (std::vector<std::uint64_t>{77, 1}));
  EXPECT_EQ(seeds_of(std::pair(4, 5)), (std::vector<std::uint64_t>{4, 5, 4, 5}));
  EXPECT_NE(error_of("title = \"t\"\nseed = 0\n"), "");
}

TEST(FaultSeeds, AreANumberOrTwo) {
  EXPECT_EQ(*parse_seeds("7"), std::pair(std::uint64_t{7}, std::uint64_t{7}));
  EXPECT_EQ(*parse_seeds("1..1000"), std::pair(std::uint64_t{1}, std::uint64_t{1000}));
  for (const char* bad : {"", "0", "5..4", "a", "1..", "..2", "-1", "1...3", "99999999999999999999"})
    EXPECT_FALSE(parse_seeds(bad)) << bad;
}

}  // namespace
}  // namespace ledgerline::hil
