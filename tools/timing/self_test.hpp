#pragma once
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/histogram.hpp"
#include "common/rt/loop_ticker.hpp"

namespace ledgerline::timing {

/// How late a loop's turns began.
struct Lateness {
  Histogram late;
  std::uint64_t overruns = 0;  ///< later than 1 ms
};

struct SelfTestOptions {
  double seconds = 10;
  int priority = 80;  ///< of our loop; cyclictest's is one lower
  int cpu = 0;
};

struct SelfTest {
  SelfTestOptions asked;
  double seconds = 0;  ///< that it took
  RealTime real_time;
  Lateness loop;
  std::optional<Lateness> cyclictest;
  std::string why_no_cyclictest;
  double steal_s = 0;  ///< of that core, meanwhile

  /// What a flight asks of a host: criterion().
  bool good() const;
};

/// The loop that link runs (common/rt/loop_ticker.hpp, 1 kHz), without drones, and cyclictest beside it on the same
/// core. Blocks for asked.seconds.
SelfTest run_self_test(const SelfTestOptions& asked);

/// From what `cyclictest --quiet --histogram` prints, for one thread. An error when that holds no sample.
Result<Lateness> parse_cyclictest(const std::string& output);

std::string to_table(const SelfTest& test);
/// Of SelfTest::good(), in words.
std::string criterion();

/// What link's way to its drones costs: UDP on this computer's loopback beside the shim's shared memory.
struct TransportsOptions {
  int drones = 16;
  int pairs = 5;       ///< of one run over each; every other pair in reverse order
  double seconds = 5;  ///< of each run
  int priority = 80;   ///< of the loop, SCHED_FIFO
  int cpu = 0;         ///< of the loop
};

/// One run: link's loop (1 kHz) with its own transport, and drones that take a setpoint each 50 ms and say a state text
/// each 100 ms, stepped every millisecond as the simulator is.
struct TransportRun {
  bool shim = false;
  double receive_us = 0, send_us = 0;  ///< mean of a turn's receive, and of one send
  Histogram to_drone, to_link,
      late;  ///< from the send until the drone has it; from the drone until link has it; of turns
  double loop_percent = 0, drones_percent = 0;  ///< of a core
  std::uint64_t lost = 0;                       ///< setpoints and state texts that did not come
  std::vector<std::string> notices;             ///< what the loop was not permitted
};

/// Blocks for 2 * pairs * seconds.
Result<std::vector<TransportRun>> run_transports(const TransportsOptions& options);

/// The median of each metric, and of the ratios shim : UDP within a pair, with the lowest and the highest.
std::string to_table(const std::vector<TransportRun>& runs);
nlohmann::json to_json(const std::vector<TransportRun>& runs);

}  // namespace ledgerline::timing
