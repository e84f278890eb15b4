#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "hil/fault/checker/checker.hpp"
#include "hil/fault/checker/rule.hpp"
#include "hil/fault/run/metrics.hpp"
#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// One drone at one moment, for pictures; a point each timeline_period_ns.
struct TimelinePoint {
  TimeNs t_ns = 0;
  std::array<float, 3> at_m{}, estimated_m{};  ///< the truth; link's estimate
  float sent_mps = 0;
  LinkPhase phase{};
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
  /// What of a checked rule is checked of a simulated run and is not of this one, in words.
  std::vector<std::string> not_checked;
  bool all_held() const;
  TimeNs flown_ns = 0;  ///< of its own clock
  bool over = false, ok = false;
  std::string why;
  crypto::Digest digest{};
  std::uint64_t blocks = 0, transactions = 0;
  std::vector<WorldEvent> events;  ///< without `applied`; at most max_events
  std::vector<std::string> drones;
  std::vector<std::string> plans;  ///< by drone: what became of them, as agent and link that ran last counted
  std::vector<std::vector<TimelinePoint>> timeline;  ///< by drone, every 50 ms
  Metrics metrics;
};
inline constexpr std::size_t max_events = 5'000;

/// What the invariants allow in a flight of this script, whose drones stand where the observations say.
Limits limits_of(const Script& script, const std::vector<DroneObservation>& drones);

/// Drones that are not on the ground, their motors off.
std::vector<std::string> in_the_air(const std::vector<DroneObservation>& drones);

/// "flying, hold (pose_lost)"; without mode and cause where there is none.
std::string mode_text(const DroneObservation& observation);

/// Has one run checked, moment by moment, and keeps of it its metrics and what pictures and reports show: a point of
/// each drone every timeline_period_ns, and the first max_events events. The run may be a simulated one or a recording
/// of a real one. One thread.
class RunRecorder {
 public:
  /// `drones`: as they stand before the first moment.
  RunRecorder(const Script& script, std::uint64_t seed, const std::vector<DroneObservation>& drones);

  void observe(const Moment& moment);
  /// Behind the last moment; what the run alone knows is for the caller to fill in.
  RunResult finish(const Ending& ending);

 private:
  void store_event(const Moment& moment, const WorldEvent& event);

  RunResult result_;
  Checker checker_;
  MetricRecorder metrics_;
  TimeNs next_point_ns_ = 0;
};

/// Flies a script in simulated time and checks it. The same script and seed give the same result, digest included. An
/// error is one of the set-up. Many threads may do this at once, each its own run.
Result<RunResult> run_script(const Script& script, std::uint64_t seed);

struct Flight {
  Script script;
  std::uint64_t seed = 1;
};

/// Flies `count` scripts in `jobs` threads, each number once. `make` and `done` are called by one thread at a time;
/// `done` in the order in which flights end. A `done` that returns false ends the campaign after the flights in
/// progress.
void fly_all(std::size_t count, unsigned jobs, const std::function<Flight(std::size_t)>& make,
             const std::function<bool(std::size_t, const Flight&, Result<RunResult>)>& done);

/// "7" or "1..1000": the first and the last.
Result<std::pair<std::uint64_t, std::uint64_t>> parse_seeds(const std::string& text);

/// Each script with each seed from `seeds`; without seeds each with its own one, or 1.
std::vector<Flight> flights_of(const std::vector<Script>& scripts,
                               const std::optional<std::pair<std::uint64_t, std::uint64_t>>& seeds);

}  // namespace ledgerline::hil
