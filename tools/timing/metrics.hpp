#pragma once
#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/rt/histogram.hpp"
#include "tools/timing/sample_trace.hpp"
#include "tools/timing/usage.hpp"

namespace ledgerline::timing {

/// A piece of the trace that has a name: what --limit and the table call it.
struct Stage {
  std::string_view name, what;
  Mark from, to;
};
/// The waterfall: each begins where the one before ends.
inline constexpr std::array<Stage, mark_count - 1> stages{{
    {"ring", "shared memory, until agent takes the sample", Mark::sampled, Mark::taken},
    {"batch", "waits for its batch", Mark::taken, Mark::batched},
    {"endorse", "the peer runs the contract and signs", Mark::batched, Mark::endorsed},
    {"order", "until the orderer acknowledges the batch", Mark::endorsed, Mark::ordered},
    {"deliver", "block cut, committed and read by ground", Mark::ordered, Mark::delivered},
    {"control", "ground makes the command", Mark::delivered, Mark::made},
    {"queue", "waits for ground's call", Mark::made, Mark::submitted},
    {"command_endorse", "as endorse", Mark::submitted, Mark::command_endorsed},
    {"command_order", "as order", Mark::command_endorsed, Mark::command_ordered},
    {"command_deliver", "block cut, committed, and on the drone's host", Mark::command_ordered, Mark::in_block},
    {"wake", "decoded, until agent's loop takes it up", Mark::in_block, Mark::picked_up},
    {"verify", "signatures, lease, limits", Mark::picked_up, Mark::verified},
    {"handover", "shared memory, until link's turn", Mark::verified, Mark::received},
    {"apply", "waits in playout for its moment", Mark::received, Mark::applied},
    {"send", "from that turn's beginning until the kernel has the datagram", Mark::applied, Mark::sent},
    {"device", "until the network device has it (SO_TIMESTAMPING)", Mark::sent, Mark::at_device},
}};
static_assert(static_cast<std::size_t>(stages.back().to) + 1 == mark_count);
/// Across several stages.
inline constexpr std::array<Stage, 4> totals{{
    {"two_way", "a state's stamp until its command is verified", Mark::sampled, Mark::verified},
    {"age", "a state's stamp until its setpoint is sent", Mark::sampled, Mark::sent},
    {"setpoint", "block on the drone's host until the setpoint is sent", Mark::in_block, Mark::sent},
    {"datagram", "a state's stamp until the network device has its setpoint", Mark::sampled, Mark::at_device},
}};
/// As `setpoint`, of those that playout did not hold back on purpose.
inline constexpr std::string_view at_once = "setpoint_at_once";
/// Of link's turns.
inline constexpr std::string_view late = "late";

/// Names of everything that has a distribution, in the order of the table.
std::vector<std::string_view> distribution_names();

/// Link's loop as cyclictest would show it.
struct LoopMetrics {
  Histogram late;
  std::uint64_t overruns = 0;  ///< later than 1 ms
  std::uint64_t lost = 0;      ///< turns whose record is not in the trace
};

/// All that is known of a time: a flight, or the last seconds of one.
struct Metrics {
  struct Distribution {
    std::string_view name, what;
    Histogram histogram;
  };
  double seconds = 0;
  std::vector<Distribution> distributions;         ///< as distribution_names()
  std::array<std::uint64_t, mark_count> got_to{};  ///< traces whose last mark it is
  std::uint64_t traces = 0;
  LoopMetrics loop;
  SampleTraces::Counters damaged;
  Load load;

  const Histogram* find(std::string_view name) const;
};

Metrics make_metrics(std::span<const SampleTrace> traces, std::span<const TraceRecord> loop_turns);

/// The five of the table, ms.
struct Tail {
  double p50 = 0, p95 = 0, p99 = 0, p999 = 0, max = 0;
  std::uint64_t count = 0;
};
Tail tail_of(const Histogram& histogram);

/// One thing that must hold:
///   p99.apply=1ms      a quantile (p50, p95, p99, p99.9, max) of a stage, a total or `late`; times in us, ms or s
///   cpu.agent+link=15% programs together, percent of one core
///   overruns=0         of link's loop
///   headroom=50%       what is left of two cores, at least
struct Limit {
  std::string text;
  std::string quantity;               ///< "p99", "cpu", "overruns", "headroom"
  std::string stage;                  ///< of a quantile
  std::vector<std::string> programs;  ///< of cpu
  double bound = 0;                   ///< ms, percent, or a count
};
/// The error names what is not known, and what there is.
Result<Limit> parse_limit(const std::string& text);

struct Verdict {
  std::string limit;
  std::optional<double> measured;  ///< in the bound's unit; none: nothing was measured, which keeps no limit
  bool kept = false;
  std::string unit{};  ///< "ms", "%"; empty: a count
  std::string note{};  ///< where there are too few samples for the quantile; else empty
};
Verdict check(const Limit& limit, const Metrics& metrics);

/// For a terminal. `max_threads`: the busiest ones.
std::string to_table(const Metrics& metrics, std::size_t max_threads);
std::string to_table(const std::vector<Verdict>& verdicts);
/// Milliseconds, to the microsecond.
nlohmann::json to_json(const Tail& tail);
/// The object of `timing --json`, without what was asked and the machine.
nlohmann::json to_json(const Metrics& metrics, const std::vector<Verdict>& verdicts);
/// The page, from that object with `asked` and `machine`. Self-contained.
std::string to_page(nlohmann::json document);

/// Chrome's trace events as JSON, which Perfetto opens: a process for each drone, whose traces lie side by side in
/// lanes, each a slice with its stages inside; and link's loop with the worst lateness of every 16 turns. Bounded: the
/// newest `max_traces`. Returns how many traces were left out.
std::size_t write_perfetto(std::ostream& out, std::span<const SampleTrace> traces,
                           std::span<const TraceRecord> loop_turns, std::size_t max_traces = 50'000);

/// How often which duration was, as one line of 40 bars from the least to the 99th percentile; empty of too few.
std::string bars_text(const Histogram& histogram);

/// The folder of a run (of `ledgerline fly`, or of `fault run --real`, which has fly's in `run`): link's, agent's and
/// ground's traces and fly's record of CPU time, complete or still growing. A program that was started again during the
/// flight has a trace of each life; of those that begin while the traces are being followed, nothing is read.
class TraceFolder {
 public:
  explicit TraceFolder(std::string directory);

  /// Reads what is new in the traces. An error when a file is damaged, or link's is not there; the other two may be
  /// missing (see missing()).
  Status read_new();
  /// Those that were not there, once all has been read.
  std::vector<std::string> missing() const;

  SampleTraces& traces() { return traces_; }
  /// Link's turns so far; `forget` takes out those before.
  const std::vector<TraceRecord>& loop_turns() const { return loop_turns_; }
  void forget_turns_before(TimeNs t_ns);

  Result<UsageRecord> usage() const;

 private:
  struct File {
    Writer writer;
    std::uint32_t life;
    std::string name;
    std::optional<TraceReader> reader = {};
  };
  std::string directory_;
  std::vector<File> files_;
  SampleTraces traces_;
  std::vector<TraceRecord> loop_turns_;
};

}  // namespace ledgerline::timing
