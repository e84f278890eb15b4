#include "hil/sitl/ledger/relay.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "hil/netem/text_parse.hpp"
#include "tests/unit/hil/sitl/tampering.hpp"

/// A peer with its real key between the operator, the drone's host and the ledger: whatever it makes of what they asked
/// for, nothing is flown that nobody signed, and every drone comes down.
namespace ledgerline::hil {
namespace {

// Lies about a take-off need one, lies about a flight need one: so both moments.
std::string script_of(const std::string& tampering, bool compared, std::uint64_t seed) {
  const std::string at = seed % 2 == 0 ? "0s" : fmt::format("path + {}ms", 500 + 400 * (seed % 7));
  const bool of_stop = tampering.starts_with("stop-") || tampering.starts_with("apply-stops-");
  const std::string stop = of_stop ? "[[fault]]\nwhat = \"operator stop tello1\"\nat = \"path + 4s\"\n" : "";
  return fmt::format(
             "title = \"A peer lies: {0}\"\nmust = [\"no crash\", \"fence kept within 0.5 m\"]\n[flight]\ndrones = "
             "{1}\n"
             "[[fault]]\nwhat = \"ledger relay {0}{2}\"\nat = \"{3}\"\n",
             tampering, tampering == "plan-drone" || seed % 5 == 0 ? 2 : 1, compared ? " compared" : "",
             of_stop ? "path + 1s" : at) +
         stop;
}

class RelayLies : public testing::TestWithParam<std::string> {};

TEST_P(RelayLies, NothingIsFlownThatNobodySigned) {
  for (const bool compared : {false, true}) {
    for (int seed = 1; seed <= seeds(slow ? 1 : 2, 20); ++seed) {
      const auto number = static_cast<std::uint64_t>(seed);
      expect_held(script_of(GetParam(), compared, number), GetParam() + (compared ? ", compared" : ""), number);
    }
  }
}

// Some of them with sanitizers: what is compared is tested whole in tests/unit/common/verification and
// tests/unit/onboard/agent.
INSTANTIATE_TEST_SUITE_P(Each, RelayLies, testing::ValuesIn(some_of(words_for<RelayTampering>())), test_name);

TEST(Relay, AnHonestPeersFlightFinishes) {
  expect_held("title = \"Nobody lies\"\nmust = [\"finishes\"]\n", "honest", 1);
}

}  // namespace
}  // namespace ledgerline::hil
