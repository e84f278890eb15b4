#include "hil/fault/compare/results_file.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "common/base/file.hpp"
#include "common/base/printable.hpp"

namespace ledgerline::hil::comparing {
namespace {

using nlohmann::json;

/// What is wrong with it; empty: nothing.
std::string text_in(const json& row, const char* key, bool needed, std::string& value) {
  const auto found = row.find(key);
  if (found == row.end()) return needed ? fmt::format("{} is missing", key) : "";
  if (!found->is_string()) return fmt::format("{} must be a text", key);
  value = printable(found->get<std::string>());
  return "";
}

std::string broken_in(const json& row, std::vector<std::string>& broken) {
  const auto found = row.find("broken");
  if (found == row.end() || !found->is_array()) return "broken must be a list of rules";
  for (const json& rule : *found) {
    if (!rule.is_string()) return "broken must be a list of rules";
    broken.push_back(printable(rule.get<std::string>()));
  }
  return "";
}

std::string figures_in(const json& row, FlownRun& run) {
  const auto found = row.find("figures");
  if (found == row.end() || !found->is_object()) return "figures must be an object of numbers";
  for (const auto& [name, value] : found->items()) {
    if (!value.is_number() || !std::isfinite(value.get<double>()))
      return fmt::format("figures.{} must be a number", printable(name));
    run.figures[printable(name)] = value.get<double>();
  }
  return "";
}

std::string run_in(const json& row, FlownRun& run) {
  if (!row.is_object()) return "must be an object";
  if (auto wrong = text_in(row, "script", true, run.script); !wrong.empty()) return wrong;
  const auto seed = row.find("seed");
  if (seed == row.end() || !seed->is_number_unsigned()) return "seed must be a whole number";
  run.seed = seed->get<std::uint64_t>();
  if (auto wrong = text_in(row, "source", false, run.source); !wrong.empty()) return wrong;
  if (auto wrong = text_in(row, "digest", false, run.digest); !wrong.empty()) return wrong;
  if (auto wrong = text_in(row, "mode", false, run.mode); !wrong.empty()) return wrong;
  if (run.mode == "virtual") run.mode = "sitl";  // in files of before
  if (auto wrong = broken_in(row, run.broken); !wrong.empty()) return wrong;
  return figures_in(row, run);
}

}  // namespace

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
    if (const std::string wrong = run_in((*rows)[i], run); !wrong.empty())
      return Error{fmt::format("{}: figures.{}: {}", file, i, wrong)};
    if (!known.emplace(run.script, run.seed).second)
      return Error{fmt::format("{}: figures.{}: {} seed {} is there twice", file, i, run.script, run.seed)};
    runs.runs.push_back(std::move(run));
  }
  return runs;
}

}  // namespace ledgerline::hil::comparing
