#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

// Tells what became worse, or better, from one build to another, of runs of the same scripts by both. Pure.

// Tests that distinguish a change from noise. They look at ranks alone: a flight's metrics follow no known
// distribution, and one flight that went astray must not decide. Pure functions; all are two-sided.

namespace ledgerline::hil::comparing {

/// What is kept of each run, however many there are, and as the file of `fault run --json` has it.
struct FlownRun {
  std::string script;
  std::uint64_t seed = 0;
  std::string source;                 ///< of which text of the script; empty: not known
  std::string digest{};               ///< of all its bytes; empty: a run that promises none, in real time
  std::string mode{};                 ///< how it was flown: "sitl", "real" ...; empty: not said
  std::vector<std::string> broken{};  ///< rules
  std::map<std::string, double, std::less<>> metrics;
  TimeNs flown_ns = 0;  ///< not in the file
};
struct Runs {
  std::string file;
  std::vector<FlownRun> runs;  ///< a script's seed is there once
};

struct Options {
  /// Chance, at most, that any test calls equal builds different. It bounds the tests alone: a fact (RuleChange) is no
  /// test, and is reported as it is.
  double error_rate = 0.01;
  bool text_may_differ = false;  ///< of scripts of one name: what is compared is two settings, not two builds
  double least_share = 0.02;     ///< of a metric's old mean: a smaller change does not count, be it ever so certain
};

enum class Change : std::uint8_t {
  none,
  small,  ///< a change, too small to count; or one whose mean goes the other way than most runs
  worse,
  better
};

/// A metric of one script, or of all together; only those of which any run differs.
struct MetricChange {
  std::string script{};  ///< empty: all scripts whose seeds are paired, by shares of each pair's mean size
  std::string metric;
  bool paired = true;                      ///< by seed; else the two have no seed in common
  std::size_t old_runs = 0, new_runs = 0;  ///< that have the metric; paired: pairs
  double old_mean = 0, new_mean = 0;       ///< of all scripts: unused
  double change = 0;                       ///< mean of the differences; of all scripts a share
  std::size_t worse = 0, better = 0;       ///< pairs
  double p = 1;                            ///< Holm's correction is in it
  Change verdict = Change::none;
};

/// A rule that broke in some run.
struct RuleChange {
  std::string script, rule;
  std::size_t old_broken = 0, old_runs = 0, new_broken = 0, new_runs = 0;
  std::vector<std::uint64_t> newly{};  ///< seeds whose run held with the old build and broke with the new one
  /// No statistics, and no part of the error rate: the same seeds, the same bytes each time, and it never broke before,
  /// or never does now; or both builds flew the same bytes, and their verdicts differ.
  bool fact = false;
  double p = 1;  ///< not of a fact
  Change verdict = Change::none;
};

struct Comparison {
  std::size_t scripts = 0;  ///< compared
  std::size_t old_runs = 0, new_runs = 0, pairs = 0, same_bytes = 0;
  std::vector<RuleChange> rules;
  std::vector<MetricChange> metrics;
  std::size_t tests = 0;              ///< that Holm's correction corrects for
  std::size_t pairs_needed = 0;       ///< seeds of one script from which on anything can be said of it alone
  std::vector<std::string> left_out;  ///< what was not compared, and why, in words
  /// Why builds that no test distinguishes are not called equal, in words: no test can get below error_rate; runs or
  /// metrics of the old build are missing in the new one; a rule broke newly, was repaired nowhere, and in too few runs
  /// to be certain.
  std::vector<std::string> cannot_tell;

  bool can_tell() const { return cannot_tell.empty(); }
  bool regression() const;
  bool improvement() const;
};

/// Runs are compared with those of the same script, text and mode. The error says why nothing can be.
Result<Comparison> compare(const Runs& old_build, const Runs& new_build, const Options& options);

/// Reads what `fault run --json` writes. An error names the file, and which run of it is wrong in what.
Result<Runs> read_results(const std::string& file);
Result<Runs> parse_results(std::string_view json, const std::string& file);

/// A table of what became worse or better, for people; `all`: of all that was tested.
std::string table_text(const Comparison& comparison, const Options& options, bool all);
/// "regression", "improvement", "equal"; "unknown": Comparison::cannot_tell says why.
std::string verdict_of(const Comparison& comparison);
/// Everything, as one JSON object.
std::string json_text(const Comparison& comparison);

struct TestResult {
  double p = 1;        ///< chance that equal builds differ so much, or more
  double least_p = 1;  ///< that with so many runs p can be at best
  int direction = 0;   ///< 1: the second sample is greater, -1: it is less, by the ranks; 0: neither
};

/// Wilcoxon's signed-rank test of paired differences (second minus first); those of 0 are left out. The distribution is
/// exact, with ties, up to max_exact_pairs; beyond that the normal one, which in the tails says a larger p than the
/// exact.
TestResult signed_rank(std::span<const double> differences);
inline constexpr std::size_t max_exact_pairs = 60;

/// The Wilcoxon-Mann-Whitney rank-sum test of two samples that nothing pairs; exact, with ties, for up to
/// max_exact_sum values together.
TestResult rank_sum(std::span<const double> first, std::span<const double> second);
inline constexpr std::size_t max_exact_sum = 30;

/// McNemar's exact test of pairs that changed: so many broke newly, and so many were repaired.
TestResult mcnemar(std::size_t newly, std::size_t repaired);

/// Fisher's exact test: so many of so many in each of two samples.
TestResult fisher(std::size_t first, std::size_t of_first, std::size_t second, std::size_t of_second);

/// Holm's correction: with these in place of the p values, the chance that any of the tests of equal builds is below
/// `error_rate` is at most `error_rate`. In the order given.
std::vector<double> holm(const std::vector<double>& p);

/// So many pairs, at least, a signed-rank test among `tests` needs to get below `error_rate` behind Holm's correction.
std::size_t pairs_needed(std::size_t tests, double error_rate);

}  // namespace ledgerline::hil::comparing
