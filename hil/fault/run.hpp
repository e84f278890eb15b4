#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "hil/fault/judge/judge.hpp"
#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// One drone at one moment, for pictures; a point each timeline_period_ns.
struct TimelinePoint {
  TimeNs t_ns = 0;
  std::array<float, 3> at_m{}, believed_m{};  ///< the truth; what link was told last
  float told_mps = 0;
  FlightPhase phase{};
  FailsafeMode mode{};
  FailsafeCause cause{};
  std::uint8_t lap = 0;
};

inline constexpr TimeNs timeline_period_ns = 50 * ns_per_ms;
TimelinePoint point_of(TimeNs now, const DroneFacts& facts);

/// What the invariants allow in a flight of this script, whose drones stand where the facts say.
Limits limits_of(const Script& script, const std::vector<DroneFacts>& drones);

struct RunResult {
  std::string script, title;
  std::uint64_t seed = 0;
  std::vector<Verdict> verdicts;  ///< the script's rules in their order, then the invariants
  /// What is judged of a virtual run and is not of this one, in words.
  std::vector<std::string> not_judged;
  bool held() const;
  TimeNs flown_ns = 0;  ///< virtual
  bool over = false, ok = false;
  std::string why;
  crypto::Digest digest{};
  std::uint64_t blocks = 0, transactions = 0;
  std::vector<WorldEvent> events;  ///< without `applied`; at most max_events
  std::vector<std::string> drones;
  std::vector<std::string> plans;  ///< by drone: what became of them, as agent and link that ran last counted
  std::vector<std::vector<TimelinePoint>> timeline;  ///< by drone, every 50 ms
  std::array<double, 2> fence_min_m{}, fence_max_m{};
};
inline constexpr std::size_t max_events = 5'000;

/// Flies a script in virtual time and judges it. The same script and seed give the same result, digest included. An
/// error is one of the set-up. Many threads may do this at once, each its own run.
Result<RunResult> run_script(const Script& script, std::uint64_t seed);

/// A script from the fault space: a flight of about 30 s with one to four faults, one in five with a death of link
/// behind which the drone is not seen; only the invariants are judged. The same number, the same script. `recording`: a
/// file of delays that some of them have (hil/lines/distribution.hpp).
Script draw_script(std::uint64_t number, const std::string& recording = {});

/// The shortest script that still fails: faults left out, laps, drones and durations made less, as long as `fails` says
/// so. Calls it at most `most` times. `script` itself must fail.
Script shrink(Script script, const std::function<bool(const Script&)>& fails, int most = 200);

}  // namespace ledgerline::hil
