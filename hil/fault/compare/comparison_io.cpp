#include "hil/fault/compare/comparison.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <set>

#include "common/base/enum_count.hpp"
#include "common/base/file.hpp"
#include "common/base/text.hpp"

namespace ledgerline::hil::comparing {
namespace {

using nlohmann::json;

std::string_view name_of(Change verdict) { return enum_names<Change>[static_cast<std::size_t>(verdict)]; }

Status text_in(const json& row, const char* key, bool needed, std::string& value) {
  const auto found = row.find(key);
  if (found == row.end() && !needed) return done;
  if (found == row.end()) return Error{fmt::format("{} is missing", key)};
  if (!found->is_string()) return Error{fmt::format("{} must be a text", key)};
  value = printable(found->get<std::string>());
  return done;
}

Status broken_in(const json& row, std::vector<std::string>& broken) {
  const auto found = row.find("broken");
  if (found == row.end() || !found->is_array()) return Error{"broken must be a list of rules"};
  for (const json& rule : *found) {
    if (!rule.is_string()) return Error{"broken must be a list of rules"};
    broken.push_back(printable(rule.get<std::string>()));
  }
  return done;
}

Status metrics_in(const json& row, FlownRun& run) {
  const auto found = row.find("figures");
  if (found == row.end() || !found->is_object()) return Error{"figures must be an object of numbers"};
  for (const auto& [name, value] : found->items()) {
    if (!value.is_number() || !std::isfinite(value.get<double>()))
      return Error{fmt::format("figures.{} must be a number", printable(name))};
    run.metrics[printable(name)] = value.get<double>();
  }
  return done;
}

Status run_in(const json& row, FlownRun& run) {
  if (!row.is_object()) return Error{"must be an object"};
  if (auto read = text_in(row, "script", true, run.script); !read) return read;
  const auto seed = row.find("seed");
  if (seed == row.end() || !seed->is_number_unsigned()) return Error{"seed must be a whole number"};
  run.seed = seed->get<std::uint64_t>();
  if (auto read = text_in(row, "source", false, run.source); !read) return read;
  if (auto read = text_in(row, "digest", false, run.digest); !read) return read;
  if (auto read = text_in(row, "mode", false, run.mode); !read) return read;
  if (run.mode == "virtual") run.mode = "sitl";  // in files of before
  if (auto read = broken_in(row, run.broken); !read) return read;
  return metrics_in(row, run);
}

}  // namespace

void to_json(json& out, Change verdict) { out = name_of(verdict); }
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RuleChange, script, rule, old_broken, old_runs, new_broken, new_runs, newly, fact, p,
                                   verdict)

Result<Runs> read_results(const std::string& file) {
  const auto text = read_file(file);
  if (!text) return text.error();
  return parse_results(*text, file);
}

Result<Runs> parse_results(std::string_view text, const std::string& file) {
  const json all = json::parse(text, nullptr, false);
  if (!all.is_object()) return Error{fmt::format("{}: is no JSON object, as `fault run --json` writes one", file)};
  const auto rows = all.find("figures");
  if (rows == all.end() || !rows->is_array() || rows->empty())
    return Error{fmt::format("{}: figures: must be a list of runs, as `fault run --json` writes one", file)};
  Runs runs{file, {}};
  std::set<std::pair<std::string, std::uint64_t>> known;
  for (std::size_t i = 0; i < rows->size(); ++i) {
    FlownRun run;
    if (const Status read = run_in((*rows)[i], run); !read)
      return Error{fmt::format("{}: figures.{}: {}", file, i, read.error().message)};
    if (!known.emplace(run.script, run.seed).second)
      return Error{fmt::format("{}: figures.{}: {} seed {} is there twice", file, i, run.script, run.seed)};
    runs.runs.push_back(std::move(run));
  }
  return runs;
}

namespace {

constexpr std::size_t max_seeds = 5;  // in a line

std::string percent_of(const MetricChange& metric) {
  if (metric.script.empty()) return fmt::format("{:+.1f} %", 100 * metric.change);
  if (metric.old_mean == 0) return fmt::format("{:+.4g}", metric.change);
  return fmt::format("{:+.1f} %", 100 * metric.change / std::abs(metric.old_mean));
}

std::string line_of(const MetricChange& metric) {
  const bool all = metric.script.empty();
  const std::string before = all ? "" : fmt::format("{:.4g}", metric.old_mean);
  const std::string now = all ? "" : fmt::format("{:.4g}", metric.new_mean);
  const std::string runs = metric.paired
                               ? fmt::format("{} of {} worse, {} better", metric.worse, metric.old_runs, metric.better)
                               : fmt::format("{} and {} runs, other seeds", metric.old_runs, metric.new_runs);
  return fmt::format("{:<6} {:<24} {:<22} {:>9} {:>9} {:>10}   {:<30} p {:.1g}\n", name_of(metric.verdict),
                     all ? "all scripts" : metric.script, metric.metric, before, now, percent_of(metric), runs,
                     metric.p);
}

std::string line_of(const RuleChange& rule) {
  std::string seeds;
  if (!rule.newly.empty()) {
    const auto end = rule.newly.begin() + static_cast<std::ptrdiff_t>(std::min(rule.newly.size(), max_seeds));
    seeds = fmt::format(", newly with seed {}{}", fmt::join(rule.newly.begin(), end, ", "),
                        rule.newly.size() > max_seeds ? ", ..." : "");
  }
  return fmt::format("{:<6} {:<24} {}: broke in {} of {} runs, then in {} of {}{}{}\n", name_of(rule.verdict),
                     rule.script, rule.rule, rule.old_broken, rule.old_runs, rule.new_broken, rule.new_runs, seeds,
                     rule.fact ? "" : fmt::format("; p {:.1g}", rule.p));
}

std::string summary_of(const Comparison& c, const Options& options) {
  std::string text = fmt::format("{} scripts, {} runs and {}", c.scripts, c.old_runs, c.new_runs);
  if (c.pairs > 0) text += fmt::format(", {} pairs of one seed, {} of them the same bytes", c.pairs, c.same_bytes);
  text += fmt::format("; {} tests: the chance that equal builds seem to differ in any is {:g} % at most\n", c.tests,
                      100 * options.error_rate);
  const auto facts = std::ranges::count_if(c.rules, &RuleChange::fact);
  if (facts > 0)
    text += fmt::format("rules that changed as a fact, without a test and outside of that chance: {}\n", facts);
  return text;
}

}  // namespace

std::string verdict_of(const Comparison& comparison) {
  if (comparison.regression()) return "regression";
  if (!comparison.can_tell()) return "unknown";
  return comparison.improvement() ? "improvement" : "equal";
}

std::string table_text(const Comparison& comparison, const Options& options, bool all) {
  std::string text;
  const auto is_reported = [all](Change verdict) {
    return all || verdict == Change::worse || verdict == Change::better;
  };
  for (const RuleChange& rule : comparison.rules) {
    if (is_reported(rule.verdict) || !rule.newly.empty()) text += line_of(rule);
  }
  std::string rows;
  for (const Change verdict : {Change::worse, Change::better, Change::small, Change::none}) {
    for (const MetricChange& metric : comparison.metrics) {
      if (metric.verdict == verdict && is_reported(verdict)) rows += line_of(metric);
    }
  }
  if (!rows.empty())
    text += fmt::format("{:<6} {:<24} {:<22} {:>9} {:>9} {:>10}   {}\n", "", "script", "figure", "old", "new", "change",
                        "runs") +
            rows;
  for (const std::string& what : comparison.left_out) text += "note: " + what + "\n";
  const std::string verdict = verdict_of(comparison);
  if (verdict != "unknown") {
    for (const std::string& why : comparison.cannot_tell) text += "note: " + why + "\n";
  }
  text += summary_of(comparison, options);
  if (verdict == "unknown")
    return text + fmt::format("unknown: {}\n", fmt::join(comparison.cannot_tell, "\nunknown: "));
  if (verdict != "equal") return text + verdict + "\n";
  const bool same_bytes = comparison.pairs > 0 && comparison.same_bytes == comparison.pairs;
  return text +
         (same_bytes && comparison.metrics.empty() ? "equal: the same bytes\n" : "equal: no change that counts\n");
}

std::string json_text(const Comparison& comparison) {
  json metrics = json::array();
  for (const MetricChange& metric : comparison.metrics) {
    json row{{"script", metric.script.empty() ? json() : json(metric.script)},
             {"figure", metric.metric},
             {"paired", metric.paired},
             {"old_runs", metric.old_runs},
             {"new_runs", metric.new_runs},
             {"change", metric.change},
             {"p", metric.p},
             {"verdict", name_of(metric.verdict)}};
    if (!metric.script.empty()) {
      row["old_mean"] = metric.old_mean;
      row["new_mean"] = metric.new_mean;
    }
    if (metric.paired) {
      row["worse"] = metric.worse;
      row["better"] = metric.better;
    }
    metrics.push_back(std::move(row));
  }
  return json{{"verdict", verdict_of(comparison)}, {"scripts", comparison.scripts},
              {"old_runs", comparison.old_runs},   {"new_runs", comparison.new_runs},
              {"pairs", comparison.pairs},         {"same_bytes", comparison.same_bytes},
              {"tests", comparison.tests},         {"pairs_needed", comparison.pairs_needed},
              {"left_out", comparison.left_out},   {"cannot_tell", comparison.cannot_tell},
              {"rules", comparison.rules},         {"figures", metrics}}
             .dump(2, ' ', false, json::error_handler_t::replace) +
         "\n";
}

}  // namespace ledgerline::hil::comparing
