#include "hil/virtual/ledger/relay.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "hil/fault/report.hpp"
#include "hil/fault/run/run.hpp"
#include "tests/unit/campaign.hpp"

/// A peer with its real key between the operator, the drone's host and the ledger: whatever it makes of what they asked
/// for, nothing is flown that nobody signed, and every drone comes down.
namespace ledgerline::hil {
namespace {

// Lies about a take-off need one, lies about a flight need one: so both moments.
Script script_of(const std::string& lie, bool compared, std::uint64_t seed) {
  const std::string at = seed % 2 == 0 ? "0s" : fmt::format("path + {}ms", 500 + 400 * (seed % 7));
  const bool of_stop = lie.starts_with("stop-") || lie.starts_with("fold-");
  const std::string stop = of_stop ? "[[fault]]\nwhat = \"operator stop tello1\"\nat = \"path + 4s\"\n" : "";
  const std::string text =
      fmt::format(
          "title = \"A peer lies: {0}\"\nmust = [\"no crash\", \"fence kept within 0.5 m\"]\n[flight]\ndrones = {1}\n"
          "[[fault]]\nwhat = \"ledger relay {0}{2}\"\nat = \"{3}\"\n",
          lie, lie == "plan-drone" || seed % 5 == 0 ? 2 : 1, compared ? " compared" : "", of_stop ? "path + 1s" : at) +
      stop;
  const auto script = parse_script(text, lie);
  EXPECT_TRUE(script) << (script ? "" : script.error().what);
  return *script;
}

class RelayLies : public testing::TestWithParam<std::string> {};

TEST_P(RelayLies, NothingIsFlownThatNobodySigned) {
  for (const bool compared : {false, true}) {
    for (int seed = 1; seed <= seeds(slow ? 1 : 2, 20); ++seed) {
      const auto number = static_cast<std::uint64_t>(seed);
      const auto result = run_script(script_of(GetParam(), compared, number), number);
      ASSERT_TRUE(result);
      for (const Verdict& verdict : result->verdicts) {
        EXPECT_TRUE(verdict.held) << "seed " << seed << (compared ? ", compared: " : ": ") << verdict.rule.text << ": "
                                  << verdict.what;
      }
    }
  }
}

// With sanitizers one of eight: what is compared is tested whole in tests/unit/common/belief and tests/unit/onboard/agent.
std::vector<std::string> lies() {
  const auto all = relay_lie_names();
  std::vector<std::string> some;
  for (std::size_t i = 0; i < all.size(); i += slow ? 8 : 1) some.emplace_back(all[i]);
  return some;
}

INSTANTIATE_TEST_SUITE_P(Each, RelayLies, testing::ValuesIn(lies()), [](const auto& lie) {
  std::string name = lie.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

TEST(Relay, AnHonestPeersFlightFinishes) {
  const auto script = parse_script("title = \"Nobody lies\"\nmust = [\"finishes\"]\n", "honest");
  ASSERT_TRUE(script);
  const auto result = run_script(*script, 1);
  ASSERT_TRUE(result);
  EXPECT_TRUE(result->held());
}

}  // namespace
}  // namespace ledgerline::hil
