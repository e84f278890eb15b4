#include "hil/sitl/ledger/serving_peer.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "hil/netem/text_parse.hpp"
#include "tests/unit/hil/sitl/tampering.hpp"

/// A drone's peer that lies to its agent about the chain: nothing is flown that nobody signed, a stop lands the drone,
/// and somebody says so. docs/faults.md.
namespace ledgerline::hil {
namespace {

/// What stays away is silence, not a contradiction.
bool is_silence(const std::string& tampering, bool restart) {
  return tampering.starts_with("withholds") || tampering == "delays" || tampering == "stutters" ||
         (tampering == "grows-old" && !restart);
}

/// Flags an orderer's blocks have none of; and what it keeps to itself, the peer tells.
bool says_nothing(const std::string& tampering) {
  return is_silence(tampering, false) || tampering.starts_with("hides") || tampering == "trusts-own" ||
         tampering == "no-flags";
}

/// Whether what an apply_stops has read is current, agent decides once it has seen one that counts.
const std::string seen_before =
    "[[fault]]\nwhat = \"operator stop tello1\"\nat = \"0s\"\n"
    "[[fault]]\nwhat = \"operator clear_stop tello1\"\nat = \"500ms\"\n";

/// Its agent may die behind the tampering, and come back.
std::string script_of(const std::string& tampering, std::uint64_t seed) {
  const bool restart = seed % 3 == 0;
  const std::string both = seed % 5 == 0 ? "[[fault]]\nwhat = \"operator stop tello2\"\nat = \"path + 6s\"\n" : "";
  return fmt::format(
      "title = \"A peer serves: {0}\"\nmust = [\"no crash\", \"fence kept within 0.5 m\", \"lands within 20 s\", "
      "\"{4}\"]\n"
      "[flight]\ndrones = {1}\nlaps = 3\n"
      "[[fault]]\nwhat = \"ledger agent serves {0}\"\nat = \"path + {2}ms\"\n"
      "[[fault]]\nwhat = \"operator stop tello1\"\nat = \"path + 6s\"\n{3}{5}",
      tampering, seed % 5 == 0 ? 2 : 1, 500 + 300 * (seed % 9),
      restart ? "[[fault]]\nwhat = \"agent kill\"\nat = \"path + 4s\"\nfor = \"700ms\"\n" : "",
      is_silence(tampering, restart)             ? "hold is seen"
      : tampering == "hides-controls" && restart ? "land is seen"  // a new agent has not seen one yet
                                                 : "the ledger is not trusted",
      tampering == "hides-controls" ? seen_before + both : both);
}

class PeerLies : public testing::TestWithParam<std::string> {};

TEST_P(PeerLies, NothingIsFlownThatNobodySignedAndAStopLands) {
  for (int seed = 1; seed <= seeds(1, 20); ++seed) {
    const auto number = static_cast<std::uint64_t>(seed);
    expect_held(script_of(GetParam(), number), GetParam(), number);
  }
}

// Some of them with sanitizers: the rule itself is tested whole in tests/unit/common/fabric/blocks.
INSTANTIATE_TEST_SUITE_P(Each, PeerLies, testing::ValuesIn(some_of(words_for<PeerTampering>())), test_name);

/// Flights in which nobody lies; `flight`: more of the script's [flight].
void expect_no_violation(const std::string& flight) {
  for (int seed = 1; seed <= seeds(slow ? 2 : 8, 1000); ++seed) {
    const auto number = static_cast<std::uint64_t>(seed);
    const std::string text = fmt::format(
        "title = \"Nobody lies\"\nmust = [\"the ledger is always trusted\"]\n[flight]\ndrones = {}\nlaps = 1\n{}"
        "[[fault]]\nwhat = \"ledger both delay {}ms\"\nat = \"path + 500ms\"\nfor = \"2s\"\n{}{}",
        1 + seed % 3, flight, 5 + seed % 60,
        seed % 4 == 0 ? "[[fault]]\nwhat = \"agent kill\"\nat = \"path + 2s\"\nfor = \"700ms\"\n" : "",
        seed % 2 == 0 ? "[[fault]]\nwhat = \"operator stop tello1\"\nat = \"path + 4s\"\n" : "");
    expect_held(text, "honest", number);
  }
}

TEST(PeerLies, AnHonestPeerIsAlwaysTrusted) { expect_no_violation(""); }

/// An orderer that has an orderer's key, and an honest peer that finds it out: agent goes on over the peer, or holds.
std::string ordered_script_of(const std::string& tampering, std::uint64_t seed) {
  return fmt::format(
      "title = \"An orderer serves: {0}\"\nmust = [\"no crash\", \"fence kept within 0.5 m\", \"lands within 20 s\", "
      "\"{3}\"]\n[flight]\nlaps = 3\nblocks = \"ordered\"\n"
      "[[fault]]\nwhat = \"ledger agent orders {0}\"\nat = \"path + {1}ms\"\n"
      "[[fault]]\nwhat = \"operator stop tello1\"\nat = \"path + 6s\"\n{2}",
      tampering, 500 + 300 * (seed % 9),
      seed % 3 == 0 ? "[[fault]]\nwhat = \"agent kill\"\nat = \"path + 4s\"\nfor = \"700ms\"\n" : "",
      says_nothing(tampering) ? "land is seen" : "the ledger is not trusted");
}

class OrdererLies : public testing::TestWithParam<std::string> {};

TEST_P(OrdererLies, NothingIsFlownThatNobodySignedAndAStopLands) {
  for (int seed = 1; seed <= seeds(1, 20); ++seed) {
    const auto number = static_cast<std::uint64_t>(seed);
    expect_held(ordered_script_of(GetParam(), number), GetParam(), number);
  }
}

INSTANTIATE_TEST_SUITE_P(Each, OrdererLies, testing::ValuesIn(some_of(words_for<PeerTampering>())), test_name);

TEST(OrdererLies, HonestOnesAreAlwaysTrusted) { expect_no_violation("blocks = \"ordered\"\n"); }

}  // namespace
}  // namespace ledgerline::hil
