// ledgerline fault compare: what became worse from one build to another.
#include <fmt/format.h>

#include <memory>

#include "common/program/program.hpp"
#include "hil/fault/compare/comparison.hpp"
#include "tools/fault/verbs.hpp"

namespace ledgerline::hil::verbs {
namespace {

struct CompareOptions {
  std::string old_file, new_file, json;
  comparing::Options options;
  bool all = false;
};

int compare_files(const CompareOptions& asked) {
  const auto old_runs = comparing::read_results(asked.old_file);
  if (!old_runs) return usage_error(old_runs.error().message);
  const auto new_runs = comparing::read_results(asked.new_file);
  if (!new_runs) return usage_error(new_runs.error().message);
  const auto comparison = comparing::compare(*old_runs, *new_runs, asked.options);
  if (!comparison) return usage_error(comparison.error().message);
  fmt::print("{}", comparing::table_text(*comparison, asked.options, asked.all));
  const bool written = asked.json.empty() || write(asked.json, comparing::json_text(*comparison));
  if (comparison->regression() || !written) return exit_broken;
  return comparison->can_tell() ? 0 : exit_usage;
}

}  // namespace

Act compare(CommandLine& line) {
  const auto asked = std::make_shared<CompareOptions>();
  Verb verb = line.verb(
      "compare", "Tells what became worse or better between two builds from their runs of the same scripts",
      R"(OLD and NEW are what `fault run --json` wrote. Runs of one script and seed are paired; a figure has changed where
Wilcoxon's signed-rank test says so behind Holm's correction for all of them (of other seeds: the rank-sum test), and its
mean did by as much as counts. A rule that broke for the first time with the same seed is a regression without statistics.
The same bytes are equal. Runs are compared with those of the same script, text and mode (sitl, real ...).

Exit codes: 0 no regression; 1 a regression, or a file could not be written; 2 bad usage, nothing to compare, or unknown:
too few runs to tell, or NEW lacks runs or figures that OLD has.)");
  verb.option("OLD", asked->old_file, "results of the old build").required().existing_file();
  verb.option("NEW", asked->new_file, "results of the new one").required().existing_file();
  verb.option("--json", asked->json, "everything that was tested, as one object");
  verb.option(
          "--error-rate", asked->options.error_rate,
          "how often the tests may distinguish equal builds; a rule that breaks for the first time is a fact, no test")
      .within(1e-9, 0.5)
      .shows_default();
  verb.option("--least", asked->options.least_share, "share of a figure by which it must change to count")
      .within(0.0, 10.0)
      .shows_default();
  verb.flag("--settings", asked->options.text_may_differ,
            "scripts of one name may differ in their text, as in a setting");
  verb.flag("--all", asked->all, "say what did not change, too");
  return {verb, [asked] { return compare_files(*asked); }};
}

}  // namespace ledgerline::hil::verbs
