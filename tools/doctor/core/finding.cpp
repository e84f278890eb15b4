#include "tools/doctor/core/finding.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/printable.hpp"

namespace ledgerline::doctor {
namespace {

const char* name_of(Verdict verdict) { return verdicts[static_cast<std::size_t>(verdict)]; }

std::string cure_of(const Finding& finding) {
  if (!finding.problem) return "";
  return finding.cure.empty() ? words_of(*finding.problem).cure : finding.cure;
}

long count(const Findings& findings, Verdict verdict) {
  return std::count_if(findings.begin(), findings.end(), [&](const Finding& f) { return f.verdict() == verdict; });
}

}  // namespace

bool anything_broken(const Findings& findings) { return count(findings, Verdict::broken) > 0; }

std::string words(const Findings& findings) {
  std::string text;
  for (const Finding& finding : findings) {
    const std::string what = printable(finding.what);
    if (!finding.problem) {
      text += fmt::format("{:<8} {:<10} {}\n", name_of(finding.verdict()), finding.check, what);
      continue;
    }
    const Words& words = words_of(*finding.problem);
    text += fmt::format("{:<8} {:<10} {}: {} ({})\n{:20}cure: {}\n", name_of(words.verdict), finding.check, words.name,
                        what, words.cause, "", printable(cure_of(finding)));
  }
  return text + fmt::format("{} ok, {} to be warned of, {} broken\n", count(findings, Verdict::ok),
                            count(findings, Verdict::warning), count(findings, Verdict::broken));
}

std::string to_json(const Findings& findings) {
  nlohmann::json checks = nlohmann::json::array();
  for (const Finding& finding : findings) {
    const bool well = !finding.problem;
    checks.push_back({{"check", finding.check},
                      {"verdict", name_of(finding.verdict())},
                      {"problem", well ? nlohmann::json() : nlohmann::json(words_of(*finding.problem).name)},
                      {"what", printable(finding.what)},
                      {"cure", well ? nlohmann::json() : nlohmann::json(printable(cure_of(finding)))}});
  }
  return nlohmann::json{{"ok", !anything_broken(findings)}, {"checks", checks}}.dump();
}

std::string problems_table() {
  std::string text = "| word | | cause | cure |\n| --- | --- | --- | --- |\n";
  for (const Words& words : all_problems())
    text += fmt::format("| `{}` | {} | {} | {} |\n", words.name, name_of(words.verdict), words.cause, words.cure);
  return text;
}

}  // namespace ledgerline::doctor
