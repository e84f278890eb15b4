// ledgerline fault list: the scenarios that there are, the kinds of faults and rules, the metrics.
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "common/program/program.hpp"
#include "hil/fault/kinds/fault.hpp"
#include "hil/fault/own_code.hpp"
#include "hil/fault/real/real_script.hpp"
#include "hil/fault/run/metrics.hpp"
#include "hil/fault/scenarios.hpp"
#include "hil/fault/script.hpp"
#include "tools/fault/verbs.hpp"

namespace ledgerline::hil::verbs {
namespace {

using nlohmann::json;

struct ListOptions {
  std::string what;
  bool json = false;
};

json json_of(const InMode& mode) {
  json refused = json::array();
  for (const auto& [example, why] : mode.refused) refused.push_back({{"fault", example}, {"why", why}});
  return {{"possible", mode.possible}, {"refused", refused}};
}

/// Rows as they are made: printed one a line, or kept for an array.
class Listing {
 public:
  explicit Listing(bool as_json) : as_json_(as_json) {}
  void add(json row, const std::string& line) {
    if (as_json_)
      rows_.push_back(std::move(row));
    else
      fmt::print("{}\n", line);
  }
  int finish(int code = 0) const {
    if (as_json_) fmt::print("{}\n", rows_.dump(2, ' ', false, json::error_handler_t::replace));
    return code;
  }

 private:
  bool as_json_;
  json rows_ = json::array();
};

int list_faults(Listing listing) {
  for (const FaultKind* kind : fault_kinds()) {
    const KindModes modes = modes_of(*kind);
    listing.add({{"form", kind->form},
                 {"modes", modes_text(modes)},
                 {"sitl", json_of(modes.sitl)},
                 {"real_embedded", json_of(modes.embedded)},
                 {"real_fabric", json_of(modes.fabric)},
                 {"real_shim", json_of(modes.shim)}},
                fmt::format("{:<66} {}", kind->form, modes_text(modes)));
  }
  return listing.finish();
}

int list_rules(Listing listing) {
  for (const RuleKind& kind : rule_kinds()) {
    const std::string modes = kind.not_real.empty() ? "sitl, real" : fmt::format("sitl ({})", kind.not_real);
    listing.add({{"rule", form_of(kind)},
                 {"help", kind.help},
                 {"sitl", true},
                 {"real", kind.not_real.empty()},
                 {"why_not_real", kind.not_real}},
                fmt::format("{:<40} {}: {}", form_of(kind), modes, kind.help));
  }
  return listing.finish();
}

int list_metrics(Listing listing) {
  for (const MetricKind& kind : metric_kinds()) {
    const char* worse = kind.less_is_worse ? "less" : "more";
    listing.add({{"figure", kind.name}, {"help", kind.help}, {"least_change", kind.least}, {"worse", worse}},
                fmt::format("{:<24} {} is worse, from {} on: {}", kind.name, worse, kind.least, kind.help));
  }
  return listing.finish();
}

/// What is asked for: a folder's scripts, or those of a group or name among the scenarios; and where groups begin.
Result<std::vector<std::string>> files_asked(const std::string& asked, std::string& folder) {
  std::error_code error;
  if (std::filesystem::is_directory(asked, error)) {
    folder = asked;
    return scripts_in(folder);
  }
  const auto library = scenario_folder(build_or_prefix());
  if (!library) return library.error();
  folder = *library;
  return asked.empty() ? scripts_in(folder) : scripts_named({asked}, build_or_prefix());
}

// As far as scripts are good; those that are not are said, and make a bad exit code.
int list_scenarios(const std::string& asked, bool as_json) {
  std::string folder;
  const auto files = files_asked(asked, folder);
  if (!files) return usage_error(files.error().message);
  Listing listing(as_json);
  std::string group_before;
  int code = 0;
  for (const std::string& file : *files) {
    const auto script = load_script(file, true);  // with what the real processes alone have
    if (!script) {
      fmt::print(stderr, "{}\n", script.error().message);
      code = exit_usage;
      continue;
    }
    const std::string group = group_of(file, folder);
    const bool simulated = check_sitl(*script).ok();
    const OwnCode given{.controller = "", .program = {"given"}};  // of one that somebody's own program flies
    const auto real =
        check_real(*script, {}, script->kind == FlightKind::path || !script->pilot.empty() ? OwnCode{} : given);
    const std::string heading =
        group == group_before ? "" : fmt::format("{}{}:\n", group_before.empty() ? "" : "\n", group);
    group_before = group;
    listing.add(
        {{"name", script->name},
         {"group", group},
         {"title", script->title},
         {"file", file},
         {"sitl", simulated},
         {"real", real.ok()},
         {"why_not_real", real ? "" : real.error().message}},
        fmt::format("{}  {:<26} {}{}", heading, script->name, script->title, simulated ? "" : " (--real --program)"));
  }
  return listing.finish(code);
}

int list_what(const ListOptions& options) {
  if (options.what == "faults") return list_faults(Listing(options.json));
  if (options.what == "rules") return list_rules(Listing(options.json));
  if (options.what == "figures") return list_metrics(Listing(options.json));
  return list_scenarios(options.what, options.json);
}

}  // namespace

Act list(CommandLine& line) {
  const auto options = std::make_shared<ListOptions>();
  Verb verb = line.verb("list", "Lists scenarios; or the kinds of faults and rules, and in which modes there are such");
  verb.option("WHAT", options->what,
              "faults, rules, figures; or a folder of scripts (./faults, if it has such a name), or a group of "
              "scenarios; left out: "
              "all that come with the program");
  verb.flag("--json", options->json, "as a list of objects");
  return {verb, [options] { return list_what(*options); }};
}

}  // namespace ledgerline::hil::verbs
