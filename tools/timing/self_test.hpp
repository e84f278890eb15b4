#pragma once
#include <optional>
#include <string>

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

  /// p99.9 below 200 us, and not above 1.5 times cyclictest's plus 50 us (where that ran): what a flight asks of a
  /// host.
  bool good() const;
};

/// The loop that link runs (common/rt/loop_ticker.hpp, 1 kHz), without drones, and cyclictest beside it on the same
/// core. Blocks for asked.seconds.
SelfTest run_self_test(const SelfTestOptions& asked);

/// From what `cyclictest --quiet --histogram` prints, for one thread. An error when that holds no sample.
Result<Lateness> parse_cyclictest(const std::string& output);

std::string to_table(const SelfTest& test);

}  // namespace ledgerline::timing
