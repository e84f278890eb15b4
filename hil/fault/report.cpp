#include "hil/fault/report.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "common/base/enum_count.hpp"
#include "common/base/text.hpp"
#include "common/msg/names.hpp"
#include "common/page/html.hpp"
#include "common/rt/histogram.hpp"
#include "hil/fault/run/metrics.hpp"

namespace ledgerline::hil {

extern const char fault_template[];

namespace {

using nlohmann::json;

json verdict_json(const Verdict& verdict) {
  json out{{"rule", verdict.rule.text}, {"held", verdict.was_checked() ? json(verdict.held) : json()}};
  if (!verdict.was_checked()) out["not_checked"] = verdict.not_checked;
  if (!verdict.held) {
    out["broken_s"] = to_seconds(verdict.broken_ns);
    out["what"] = verdict.what;
  }
  return out;
}

json events_json(const RunResult& result) {
  json events = json::array();
  for (const WorldEvent& event : result.events)
    events.push_back({{"t_s", rounded(to_seconds(event.t_ns))},
                      {"drone", result.drones.at(event.drone)},
                      {"kind", enum_names<WorldEvent::Kind>[static_cast<std::size_t>(event.kind)]},
                      {"text", event.text}});
  return events;
}

json run_json(const RunResult& result) {
  json verdicts = json::array();
  for (const Verdict& verdict : result.verdicts) verdicts.push_back(verdict_json(verdict));
  return {{"script", result.script},
          {"title", result.title},
          {"seed", result.seed},
          {"held", result.all_held()},
          {"verdicts", verdicts},
          {"not_checked", result.not_checked},
          {"flown_s", to_seconds(result.flown_ns)},
          {"finished", result.ok},
          {"why", result.why},
          {"plans", result.plans},
          {"digest", crypto::hex(result.digest)},
          {"blocks", result.blocks},
          {"transactions", result.transactions},
          {"events", events_json(result)}};
}

json summary_json(const RunSummary& run) {
  json out{{"script", run.script},
           {"seed", run.seed},
           {"source", run.source},
           {"broken", run.broken},
           {"figures", json(run.metrics)}};
  if (!run.digest.empty()) out["digest"] = run.digest;
  if (!run.mode.empty()) out["mode"] = run.mode;
  return out;
}

json not_flown_json(const NotFlown& flight) {
  json out{{"script", flight.script}, {"why", flight.why}, {"error", flight.error}};
  if (flight.seed) out["seed"] = *flight.seed;
  return out;
}

json timeline_json(const std::vector<TimelinePoint>& points) {
  json out = json::array();
  for (const TimelinePoint& p : points)
    out.push_back({rounded(to_seconds(p.t_ns)), rounded(p.at_m[0]), rounded(p.at_m[1]), rounded(p.at_m[2]),
                   rounded(p.estimated_m[0]), rounded(p.estimated_m[1]), rounded(p.estimated_m[2]), rounded(p.sent_mps),
                   static_cast<int>(p.phase), static_cast<int>(p.mode), name(p.cause), p.lap});
  return out;
}

}  // namespace

std::string broken_text(const RunResult& result) {
  std::vector<Verdict> broken = result.verdicts;
  std::erase_if(broken, &Verdict::held);
  std::ranges::stable_sort(broken, {}, &Verdict::broken_ns);
  std::string text;
  for (const Verdict& verdict : broken)
    text +=
        fmt::format("  broke at {:.3f} s: {}: {}\n", to_seconds(verdict.broken_ns), verdict.rule.text, verdict.what);
  return text;
}

std::string not_checked_text(const RunResult& result) {
  std::map<std::string, std::vector<std::string>> rules;  // by why
  for (const Verdict& verdict : result.verdicts) {
    if (!verdict.was_checked()) rules[verdict.not_checked].push_back(verdict.rule.text);
  }
  std::string text;
  for (const auto& [why, names] : rules) text += fmt::format("  not checked: {} ({})\n", fmt::join(names, "; "), why);
  for (const std::string& what : result.not_checked) text += fmt::format("  not checked: {}\n", what);
  return text;
}

RunSummary summary_of(const RunResult& result, const std::string& source) {
  RunSummary summary{
      .script = result.script, .seed = result.seed, .source = source, .metrics = {}, .flown_ns = result.flown_ns};
  for (const MetricValue& metric : result.metrics) summary.metrics.emplace(metric.name, metric.value);
  if (result.digest != crypto::Digest{}) summary.digest = crypto::hex(result.digest);
  for (const Verdict& verdict : result.verdicts) {
    if (!verdict.held) summary.broken.push_back(verdict.rule.text);
  }
  return summary;
}

std::string source_of(std::string_view script_text) {
  constexpr std::size_t digits = 16;
  return crypto::hex(crypto::sha256(script_text)).substr(0, digits);
}

std::string json_text(const std::vector<RunResult>& results, const std::vector<RunSummary>& all,
                      const std::vector<NotFlown>& not_flown) {
  json runs = json::array(), missing = json::array();
  for (const NotFlown& flight : not_flown) missing.push_back(not_flown_json(flight));
  for (const RunResult& result : results) runs.push_back(run_json(result));
  const auto broken = std::ranges::count_if(all, [](const RunSummary& run) { return !run.broken.empty(); });
  std::string text = json{
      {"held", broken == 0 && std::ranges::none_of(not_flown, &NotFlown::error)},
      {"runs", runs},
      {"flown", all.size()},
      {"broken", broken},
      {"interrupted", std::ranges::any_of(not_flown, &NotFlown::interrupted)},
      {"not_flown",
       missing}}.dump(2, ' ', false, json::error_handler_t::replace);
  text.resize(text.rfind('\n'));  // the last brace comes behind what may be hundred thousand lines
  text += ",\n  \"figures\": [";
  for (std::size_t i = 0; i < all.size(); ++i)
    text += (i > 0 ? ",\n    " : "\n    ") + summary_json(all[i]).dump(-1, ' ', false, json::error_handler_t::replace);
  return text + "\n  ]\n}\n";
}

std::string junit_text(const std::vector<RunResult>& results, const std::vector<RunSummary>& all,
                       const std::vector<NotFlown>& not_flown) {
  std::map<std::pair<std::string, std::uint64_t>, const RunResult*> in_full;
  for (const RunResult& result : results) in_full[{result.script, result.seed}] = &result;
  const auto broken = std::ranges::count_if(all, [](const RunSummary& run) { return !run.broken.empty(); });
  std::string text = fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuite name=\"ledgerline fault\" tests=\"{}\" "
      "failures=\"{}\" errors=\"{}\" skipped=\"{}\">\n",
      all.size() + not_flown.size(), broken, std::ranges::count_if(not_flown, &NotFlown::error),
      std::ranges::count_if(not_flown, [](const NotFlown& flight) { return !flight.error; }));
  for (const RunSummary& run : all) {
    const auto found = in_full.find({run.script, run.seed});
    const RunResult* result = found == in_full.end() ? nullptr : found->second;
    text += fmt::format("  <testcase classname=\"{}\" name=\"seed {}\" time=\"{:.3f}\">\n", xml_text(run.script),
                        run.seed, to_seconds(run.flown_ns));
    if (!run.broken.empty())
      text += fmt::format("    <failure message=\"{}\">{}</failure>\n", xml_text(result ? result->title : run.script),
                          xml_text(result ? broken_text(*result) : fmt::format("{}", fmt::join(run.broken, "\n"))));
    if (result && !result->not_checked.empty())
      text += fmt::format("    <system-out>{}</system-out>\n", xml_text(not_checked_text(*result)));
    text += "  </testcase>\n";
  }
  for (const NotFlown& flight : not_flown)
    text += fmt::format("  <testcase classname=\"{}\" name=\"{}\">\n    <{} message=\"{}\"/>\n  </testcase>\n",
                        xml_text(flight.script), flight.seed ? fmt::format("seed {}", *flight.seed) : "not flown",
                        flight.error ? "error" : "skipped", xml_text(flight.why));
  return text + "</testsuite>\n";
}

std::string counted(std::size_t count, std::string_view what) {
  return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
}

std::vector<BrokenRule> by_rule(const std::vector<RunSummary>& all) {
  std::map<std::string, std::pair<std::size_t, std::set<std::string>>> broken;  // runs, scripts
  for (const RunSummary& run : all) {
    for (const std::string& rule : run.broken) {
      ++broken[rule].first;
      broken[rule].second.insert(run.script);
    }
  }
  std::vector<BrokenRule> rules;
  for (const auto& [rule, where] : broken) rules.push_back({rule, where.first, where.second.size()});
  std::ranges::stable_sort(rules, std::ranges::greater(), &BrokenRule::runs);
  return rules;
}

std::string by_rule_text(const std::vector<RunSummary>& all) {
  std::string text;
  for (const BrokenRule& one : by_rule(all))
    text += fmt::format("  {} of {} broke: {}\n", counted(one.runs, "run"), counted(one.scripts, "script"), one.rule);
  return text;
}

std::string csv_text(const std::vector<RunSummary>& all) {
  std::string text = "script,seed,mode,held,flown_s,broken";
  constexpr std::string_view has_column = "flown_s";
  for (const MetricKind& kind : metric_kinds()) text += kind.name == has_column ? "" : fmt::format(",{}", kind.name);
  for (const RunSummary& run : all) {
    std::string broken = fmt::format("{}", fmt::join(run.broken, "; "));
    std::ranges::replace(broken, '"', '\'');
    text += fmt::format("\n\"{}\",{},{},{},{:.3f},\"{}\"", run.script, run.seed, run.mode, run.broken.empty(),
                        to_seconds(run.flown_ns), broken);
    for (const MetricKind& kind : metric_kinds()) {
      if (kind.name == has_column) continue;
      const auto metric = run.metrics.find(kind.name);
      text += metric == run.metrics.end() ? "," : fmt::format(",{}", metric->second);
    }
  }
  return text + "\n";
}

std::string html_text(const std::vector<RunResult>& results, const std::vector<RunSummary>& all,
                      const std::vector<NotFlown>& not_flown) {
  json runs = json::array();
  for (const RunResult& result : results) {
    json run = run_json(result);
    json drones = json::array();
    for (std::size_t i = 0; i < result.drones.size(); ++i)
      drones.push_back({{"id", result.drones[i]}, {"points", timeline_json(result.timeline[i])}});
    run["drones"] = drones;
    runs.push_back(run);
  }
  json rules = json::array();
  for (const BrokenRule& one : by_rule(all))
    rules.push_back({{"rule", one.rule}, {"runs", one.runs}, {"scripts", one.scripts}});
  std::string page = page::filled(fault_template, "@DATE@", page::local_date());
  json missing = json::array();
  for (const NotFlown& flight : not_flown) missing.push_back(not_flown_json(flight));
  page = page::filled(page, "@RULES@", page::for_script(rules));
  page = page::filled(page, "@NOT_FLOWN@", page::for_script(missing));
  return page::filled(page, "@DATA@", page::for_script(runs));
}

}  // namespace ledgerline::hil
