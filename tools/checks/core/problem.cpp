#include "tools/checks/core/problem.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/text.hpp"

namespace ledgerline::checks {
namespace {

constexpr std::array<Description, problem_count> table{{
#define LEDGERLINE_PROBLEM(name, severity, cause, cure) {#name, Severity::severity, cause, cure},
    LEDGERLINE_PROBLEMS(LEDGERLINE_PROBLEM)
#undef LEDGERLINE_PROBLEM
}};

const char* name_of(Severity severity) { return severities[static_cast<std::size_t>(severity)]; }

std::string cure_of(const Finding& finding) {
  if (!finding.problem) return "";
  return printable(finding.cure.empty() ? describe(*finding.problem).cure : finding.cure);
}

std::string what_of(const Finding& finding) {
  return printable(finding.drone.empty() ? finding.what : finding.drone + ": " + finding.what);
}

long count(const Findings& findings, Severity severity) {
  return std::count_if(findings.begin(), findings.end(), [&](const Finding& f) { return f.severity == severity; });
}

nlohmann::json or_null(const std::string& text) { return text.empty() ? nlohmann::json() : nlohmann::json(text); }

}  // namespace

const std::array<Description, problem_count>& all_problems() { return table; }

std::string cure_of(Problem problem, std::string_view placeholder, std::string_view value) {
  std::string cure = describe(problem).cure;
  for (std::size_t at = 0; (at = cure.find(placeholder, at)) != std::string::npos; at += value.size())
    cure.replace(at, placeholder.size(), value);
  return cure;
}

Finding fine(std::string check, std::string what) { return {.check = std::move(check), .what = std::move(what)}; }

Finding flag(Problem problem, std::string check, std::string what, std::string cure) {
  return {std::move(check), "", std::move(what), problem, describe(problem).severity, std::move(cure)};
}

Finding as_broken(Finding finding) {
  finding.severity = Severity::broken;
  return finding;
}

Finding of_drone(std::string drone, Finding finding) {
  finding.drone = std::move(drone);
  return finding;
}

void add(Findings& all, Findings more) {
  all.insert(all.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
}

Findings without_repeats(Findings findings) {
  Findings all;
  for (Finding& one : findings) {
    const bool is_reported = std::any_of(all.begin(), all.end(), [&](const Finding& other) {
      return other.problem == one.problem && other.check == one.check && other.drone == one.drone &&
             other.what == one.what;
    });
    if (!is_reported) all.push_back(std::move(one));
  }
  return all;
}

bool anything_broken(const Findings& findings) { return count(findings, Severity::broken) > 0; }

std::string words(const Findings& findings) {
  std::string text;
  for (const Finding& finding : findings) {
    text += fmt::format("{:<8} {:<11} ", name_of(finding.severity), finding.check);
    if (finding.problem) {
      const Description& problem = describe(*finding.problem);
      text += fmt::format("{}: {} ({})\n{:21}cure: {}\n", problem.name, what_of(finding), problem.cause, "",
                          cure_of(finding));
    } else {
      text += what_of(finding) + "\n";
    }
  }
  return text + fmt::format("{} ok, {} to be warned of, {} broken\n", count(findings, Severity::ok),
                            count(findings, Severity::warning), count(findings, Severity::broken));
}

Status check(const Findings& findings) {
  std::string text;
  for (const Finding& finding : findings) {
    if (finding.severity != Severity::broken) continue;
    const std::string whose = finding.drone.empty() ? "" : finding.drone + "'s ";
    text += printable(fmt::format("{}{}{}: {}: {} (cure: {})", text.empty() ? "" : "; ", whose, finding.check,
                                  finding.what, describe(*finding.problem).cause, cure_of(finding)));
  }
  if (!text.empty()) return Error{text};
  return done;
}

std::string to_json(const Findings& findings) {
  nlohmann::json checks = nlohmann::json::array();
  for (const Finding& finding : findings) {
    checks.push_back({{"check", finding.check},
                      {"drone", or_null(printable(finding.drone))},
                      {"verdict", name_of(finding.severity)},
                      {"problem", or_null(finding.problem ? describe(*finding.problem).name : "")},
                      {"what", printable(finding.what)},
                      {"cure", or_null(cure_of(finding))}});
  }
  return nlohmann::json{{"ok", !anything_broken(findings)}, {"checks", checks}}.dump();
}

std::string problems_table() {
  std::string text = "| word | cause | cure |\n| --- | --- | --- |\n";
  for (const Description& one : all_problems()) {
    const char* mark = one.severity == Severity::warning ? " (warning)" : "";
    text += fmt::format("| `{}`{} | {} | {} |\n", one.name, mark, one.cause, one.cure);
  }
  return text;
}

}  // namespace ledgerline::checks
