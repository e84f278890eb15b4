#include "hil/fault/compare/comparison.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

#include "hil/fault/run/metrics.hpp"

namespace ledgerline::hil::comparing {
namespace {

using BySeed = std::map<std::uint64_t, const FlownRun*>;
using ScriptAndMode = std::pair<std::string, std::string>;
using ByScript = std::map<ScriptAndMode, BySeed>;

ByScript by_script(const Runs& runs) {
  ByScript all;
  for (const FlownRun& run : runs.runs) all[{run.script, run.mode}][run.seed] = &run;
  return all;
}

/// The modes in which a script was flown, in words; empty: it was not.
std::string modes_of(const ByScript& runs, const std::string& script) {
  std::vector<std::string> modes;
  for (const auto& [key, by_seed] : runs) {
    if (key.first == script) modes.push_back(key.second.empty() ? "a mode that is not said" : key.second);
  }
  return fmt::format("{}", fmt::join(modes, " and "));
}

bool broke(const FlownRun& run, const std::string& rule) {
  return std::find(run.broken.begin(), run.broken.end(), rule) != run.broken.end();
}

std::optional<double> value_in(const FlownRun& run, std::string_view metric) {
  const auto found = run.metrics.find(metric);
  return found == run.metrics.end() ? std::nullopt : std::optional(found->second);
}

std::vector<double> values_in(const std::vector<const FlownRun*>& runs, std::string_view metric) {
  std::vector<double> values;
  for (const FlownRun* run : runs) {
    if (const auto value = value_in(*run, metric)) values.push_back(*value);
  }
  return values;
}

double mean_of(const std::vector<double>& values) {
  const double sum = std::accumulate(values.begin(), values.end(), 0.0);
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

Change one_way(bool worse) { return worse ? Change::worse : Change::better; }

/// One script's runs by both builds.
struct Both {
  std::string script;
  std::vector<const FlownRun*> old_runs, new_runs;  ///< that are compared: pairs stand side by side
  bool paired = false;
  bool bytes = true;           ///< every run promises its bytes
  std::size_t same_bytes = 0;  ///< pairs
};

class Comparer {
 public:
  Comparer(const Runs& old_build, const Runs& new_build, const Options& options)
      : old_(old_build), new_(new_build), options_(options) {}

  Result<Comparison> compare() {
    collect();
    if (scripts_.empty())
      return Error{fmt::format("{} and {} have no script that can be compared{}{}", old_.file, new_.file,
                               out_.left_out.empty() ? "" : ":\n  ", fmt::join(out_.left_out, "\n  "))};
    for (const Both& both : scripts_) {
      compare_rules(both);
      for (const MetricKind& kind : metric_kinds()) compare_metric(both, kind);
    }
    for (const MetricKind& kind : metric_kinds()) compare_all_scripts(kind);
    decide();
    return std::move(out_);
  }

 private:
  struct Test {
    TestResult result;
    bool of_rule = false;
    std::size_t which = 0;  ///< of out_.rules or out_.metrics
    double least = 0;       ///< a smaller change does not count
    bool less_is_worse = false;
  };

  void collect() {
    const ByScript old_runs = by_script(old_), new_runs = by_script(new_);
    for (const auto& [key, runs] : old_runs) {
      const std::string& script = key.first;
      const auto found = new_runs.find(key);
      if (found == new_runs.end()) {
        missing_runs_ += runs.size();
        const std::string modes = modes_of(new_runs, script);
        if (modes.empty())
          leave_out("{}: only in {}", script, old_.file);
        else
          leave_out("{}: flown in {} in {}, in {} in {}: only the same mode is compared", script,
                    modes_of(old_runs, script), old_.file, modes, new_.file);
      } else if (!options_.text_may_differ && runs.begin()->second->source != found->second.begin()->second->source) {
        leave_out("{}: its text is another one in {} (--settings compares them)", script, new_.file);
      } else {
        add_script(script, runs, found->second);
      }
    }
    for (const auto& [key, runs] : new_runs) {
      if (modes_of(old_runs, key.first).empty()) leave_out("{}: only in {}", key.first, new_.file);
    }
    const std::set<std::string> before = unknown_metrics(old_), now = unknown_metrics(new_);
    std::set<std::string> unknown = before;
    unknown.insert(now.begin(), now.end());
    for (const std::string& metric : unknown) leave_out("{}: no figure that this program knows", metric);
    std::ranges::set_difference(before, now, std::inserter(missing_metrics_, missing_metrics_.end()));
  }

  static std::set<std::string> unknown_metrics(const Runs& runs) {
    std::set<std::string> unknown;
    for (const FlownRun& run : runs.runs) {
      for (const auto& [metric, value] : run.metrics) {
        if (!metric_kind(metric)) unknown.insert(metric);
      }
    }
    return unknown;
  }

  void add_script(const std::string& script, const BySeed& old_runs, const BySeed& new_runs) {
    Both both;
    both.script = script;
    std::size_t alone = 0;  // seeds
    for (const auto& [seed, run] : old_runs) {
      const auto found = new_runs.find(seed);
      if (found == new_runs.end()) {
        ++alone;
        continue;
      }
      both.old_runs.push_back(run);
      both.new_runs.push_back(found->second);
      if (!run->digest.empty() && run->digest == found->second->digest) ++both.same_bytes;
    }
    both.paired = !both.old_runs.empty();
    if (both.paired) missing_runs_ += alone;
    alone += new_runs.size() - both.new_runs.size();
    if (!both.paired) {
      for (const auto& [seed, run] : old_runs) both.old_runs.push_back(run);
      for (const auto& [seed, run] : new_runs) both.new_runs.push_back(run);
    } else if (alone > 0) {
      leave_out("{}: {} runs whose seed is in one file alone", script, alone);
    }
    for (const auto* runs : {&both.old_runs, &both.new_runs}) {
      both.bytes = both.bytes && std::ranges::none_of(*runs, [](const FlownRun* run) { return run->digest.empty(); });
    }
    ++out_.scripts;
    out_.old_runs += both.old_runs.size();
    out_.new_runs += both.new_runs.size();
    out_.pairs += both.paired ? both.old_runs.size() : 0;
    out_.same_bytes += both.same_bytes;
    scripts_.push_back(std::move(both));
  }

  void compare_rules(const Both& both) {
    std::set<std::string> rules;
    for (const auto* runs : {&both.old_runs, &both.new_runs}) {
      for (const FlownRun* run : *runs) rules.insert(run->broken.begin(), run->broken.end());
    }
    for (const std::string& rule : rules) compare_rule(both, rule);
  }

  void compare_rule(const Both& both, const std::string& rule) {
    RuleChange change{
        .script = both.script, .rule = rule, .old_runs = both.old_runs.size(), .new_runs = both.new_runs.size()};
    const auto breaks = [&](const FlownRun* run) { return broke(*run, rule); };
    change.old_broken = static_cast<std::size_t>(std::ranges::count_if(both.old_runs, breaks));
    change.new_broken = static_cast<std::size_t>(std::ranges::count_if(both.new_runs, breaks));
    std::size_t repaired = 0;
    for (std::size_t i = 0; both.paired && i < both.old_runs.size(); ++i) {
      const bool before = broke(*both.old_runs[i], rule), now = broke(*both.new_runs[i], rule);
      if (now && !before) change.newly.push_back(both.new_runs[i]->seed);
      if (before && !now) ++repaired;
    }
    const bool differs = !both.paired || change.newly.size() + repaired > 0;
    change.fact = both.paired && both.bytes && differs &&
                  (change.old_broken == 0 || change.new_broken == 0 || both.same_bytes == both.old_runs.size());
    if (change.fact) {
      change.verdict = one_way(!change.newly.empty());
    } else if (differs) {
      const TestResult result = both.paired
                                    ? mcnemar(change.newly.size(), repaired)
                                    : fisher(change.old_broken, change.old_runs, change.new_broken, change.new_runs);
      tests_.push_back({.result = result, .of_rule = true, .which = out_.rules.size()});
    }
    out_.rules.push_back(std::move(change));
  }

  void compare_metric(const Both& both, const MetricKind& kind) {
    std::vector<double> before, now, differences;
    MetricChange change{.script = both.script, .metric = std::string(kind.name), .paired = both.paired};
    if (both.paired) {
      std::size_t lost = 0, new_ones = 0;
      for (std::size_t i = 0; i < both.old_runs.size(); ++i) {
        const auto a = value_in(*both.old_runs[i], kind.name), b = value_in(*both.new_runs[i], kind.name);
        if (a && !b) ++lost;
        if (b && !a) ++new_ones;
        if (!a || !b) continue;
        before.push_back(*a);
        now.push_back(*b);
        differences.push_back(*b - *a);
        if (*a != *b) ++((*b > *a) == kind.less_is_worse ? change.better : change.worse);
      }
      if (lost + new_ones > 0)
        leave_out("{}: {}: of {} seeds only {} has it, of {} only {}", both.script, kind.name, lost, old_.file,
                  new_ones, new_.file);
      if (lost > 0) missing_metrics_.emplace(kind.name);
    } else {
      before = values_in(both.old_runs, kind.name);
      now = values_in(both.new_runs, kind.name);
      if (!before.empty() && now.empty()) missing_metrics_.emplace(kind.name);
    }
    const TestResult result = both.paired ? signed_rank(differences) : rank_sum(before, now);
    const bool differs = both.paired ? change.worse + change.better > 0 : !before.empty() && !now.empty();
    if (!differs) return;
    change.old_runs = before.size();
    change.new_runs = now.size();
    change.old_mean = mean_of(before);
    change.new_mean = mean_of(now);
    change.change = change.new_mean - change.old_mean;
    tests_.push_back({.result = result,
                      .which = out_.metrics.size(),
                      .least = std::max(kind.least, options_.least_share * std::abs(change.old_mean)),
                      .less_is_worse = kind.less_is_worse});
    out_.metrics.push_back(std::move(change));
  }

  // What a few seeds of each script cannot show, all scripts together can: each pair's difference as a share of its
  // mean size, where it is large enough to count at all.
  void compare_all_scripts(const MetricKind& kind) {
    std::vector<double> differences;
    std::size_t scripts = 0;
    MetricChange change{.metric = std::string(kind.name)};
    for (const Both& both : scripts_) {
      if (!both.paired) continue;
      ++scripts;
      for (std::size_t i = 0; i < both.old_runs.size(); ++i) {
        const auto a = value_in(*both.old_runs[i], kind.name), b = value_in(*both.new_runs[i], kind.name);
        if (!a || !b) continue;
        const bool counts = std::abs(*b - *a) >= kind.least;
        differences.push_back(counts ? 2 * (*b - *a) / (std::abs(*a) + std::abs(*b)) : 0);
        if (counts) ++((*b > *a) == kind.less_is_worse ? change.better : change.worse);
      }
    }
    if (scripts < 2 || change.worse + change.better == 0) return;
    change.old_runs = change.new_runs = differences.size();
    change.change = mean_of(differences);
    tests_.push_back({.result = signed_rank(differences),
                      .which = out_.metrics.size(),
                      .least = options_.least_share,
                      .less_is_worse = kind.less_is_worse});
    out_.metrics.push_back(std::move(change));
  }

  void decide() {
    // Tests that could not show anything even alone, of too few runs that differ, cost the others nothing (Tarone
    // 1990).
    std::vector<Test> able;
    for (const Test& test : tests_) {
      if (test.result.least_p <= options_.error_rate) able.push_back(test);
    }
    std::vector<double> p;
    double least_p = 1;
    for (const Test& test : able) {
      p.push_back(test.result.p);
      least_p = std::min(least_p, test.result.least_p);
    }
    const std::vector<double> corrected = holm(p);
    out_.tests = able.size();
    out_.pairs_needed = pairs_needed(tests_.size(), options_.error_rate);
    const bool enough = std::ranges::any_of(scripts_, [&](const Both& both) {
      return both.paired && both.same_bytes < both.old_runs.size() && both.old_runs.size() >= out_.pairs_needed;
    });
    if (!tests_.empty() && !enough &&
        (able.empty() || least_p * static_cast<double>(able.size()) > options_.error_rate))
      cannot_tell("too few runs to tell anything; fly each script with {} seeds at least", out_.pairs_needed);
    for (std::size_t i = 0; i < able.size(); ++i) {
      const Test& test = able[i];
      const bool certain = corrected[i] <= options_.error_rate;
      if (test.of_rule) {
        RuleChange& rule = out_.rules[test.which];
        rule.p = corrected[i];
        if (certain) rule.verdict = one_way(test.result.direction > 0);
        continue;
      }
      MetricChange& metric = out_.metrics[test.which];
      metric.p = corrected[i];
      if (!certain) continue;
      const bool counts = std::abs(metric.change) >= test.least && (metric.change > 0) == (test.result.direction > 0);
      metric.verdict = counts ? one_way((metric.change > 0) != test.less_is_worse) : Change::small;
    }
    add_what_is_missing();
    add_what_may_be_worse();
    add_few_seeds();
  }

  void add_what_is_missing() {
    if (missing_runs_ > 0) cannot_tell("{} lacks {} runs that {} has", new_.file, missing_runs_, old_.file);
    if (!missing_metrics_.empty())
      cannot_tell("{} lacks figures that {} has: {}", new_.file, old_.file, fmt::join(missing_metrics_, ", "));
  }

  // A rule that broke newly and was repaired nowhere, in so few runs that no test is certain.
  void add_what_may_be_worse() {
    for (const RuleChange& rule : out_.rules) {
      const bool none_repaired = rule.old_broken + rule.newly.size() == rule.new_broken;
      if (rule.verdict == Change::none && !rule.newly.empty() && none_repaired)
        cannot_tell(
            "{}: {}: newly broken with {} of {} seeds, repaired with none: fly more seeds to distinguish that from "
            "chance",
            rule.script, rule.rule, rule.newly.size(), rule.new_runs);
    }
  }

  void add_few_seeds() {
    const auto few = std::ranges::count_if(scripts_, [&](const Both& both) {
      return both.paired && both.same_bytes < both.old_runs.size() && both.old_runs.size() < out_.pairs_needed;
    });
    if (few > 0)
      leave_out("{} scripts have fewer seeds than the {} that show anything of one script's figures{}", few,
                out_.pairs_needed, scripts_.size() > 1 ? ": they are reported for all scripts together" : "");
  }

  template <typename... Words>
  void leave_out(fmt::format_string<Words...> format, Words&&... words) {
    out_.left_out.push_back(fmt::format(format, std::forward<Words>(words)...));
  }

  template <typename... Words>
  void cannot_tell(fmt::format_string<Words...> format, Words&&... words) {
    out_.cannot_tell.push_back(fmt::format(format, std::forward<Words>(words)...));
  }

  const Runs &old_, &new_;
  Options options_;
  std::vector<Both> scripts_;
  std::vector<Test> tests_;
  std::size_t missing_runs_ = 0;           // that the old build has and the new one has not
  std::set<std::string> missing_metrics_;  // the same
  Comparison out_;
};

bool any(const Comparison& comparison, Change verdict) {
  const auto is = [verdict](const auto& change) { return change.verdict == verdict; };
  return std::ranges::any_of(comparison.rules, is) || std::ranges::any_of(comparison.metrics, is);
}

}  // namespace

bool Comparison::regression() const { return any(*this, Change::worse); }
bool Comparison::improvement() const { return any(*this, Change::better); }

Result<Comparison> compare(const Runs& old_build, const Runs& new_build, const Options& options) {
  return Comparer(old_build, new_build, options).compare();
}

}  // namespace ledgerline::hil::comparing
