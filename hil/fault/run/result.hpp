#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "hil/fault/checker/rule.hpp"
#include "hil/fault/run/figures.hpp"

namespace ledgerline::hil {

/// One drone at one moment, for pictures; a point each timeline_period_ns.
struct TimelinePoint {
  TimeNs t_ns = 0;
  std::array<float, 3> at_m{}, estimated_m{};  ///< the truth; link's estimate
  float sent_mps = 0;
  FlightPhase phase{};
  FailsafeMode mode{};
  FailsafeCause cause{};
  std::uint8_t lap = 0;
};

inline constexpr TimeNs timeline_period_ns = 50 * ns_per_ms;

/// What became of one run of a script.
struct RunResult {
  std::string script, title;
  std::uint64_t seed = 0;
  std::vector<Verdict> verdicts;  ///< the script's rules in their order, then the invariants
  /// What is checked of a simulated run and is not of this one, in words.
  std::vector<std::string> not_checked;
  bool held() const;
  TimeNs flown_ns = 0;  ///< of its own clock
  bool over = false, ok = false;
  std::string why;
  crypto::Digest digest{};
  std::uint64_t blocks = 0, transactions = 0;
  std::vector<WorldEvent> events;  ///< without `applied`; at most max_events
  std::vector<std::string> drones;
  std::vector<std::string> plans;  ///< by drone: what became of them, as agent and link that ran last counted
  std::vector<std::vector<TimelinePoint>> timeline;  ///< by drone, every 50 ms
  std::array<double, 2> fence_min_m{}, fence_max_m{};
  Figures figures;
};
inline constexpr std::size_t max_events = 5'000;

}  // namespace ledgerline::hil
