// ledgerline fault check: what is wrong with scripts, without flying them.
#include "hil/fault/real/real.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "common/base/file.hpp"
#include "common/program/program.hpp"
#include "hil/fault/own_code.hpp"
#include "hil/fault/script.hpp"
#include "hil/fault/verbs/verbs.hpp"

namespace ledgerline::hil::verbs {
namespace {

struct CheckOptions {
  std::vector<std::string> scripts;
  bool real = false, shim = false;
  std::string ledger = "embedded";  // of --real
};

int check_scripts(const CheckOptions& options) {
  const auto files = scripts_named(options.scripts, program_folder());
  if (!files) return usage_error(files.error().message);
  std::optional<RealStack> real;
  if (options.real) real = RealStack{options.ledger == "fabric", options.shim};
  std::size_t wrong = 0;
  for (const std::string& file : *files) {
    const auto text = read_file(file);
    const auto script = text ? check_script(*text, file, real) : Result<Script>(text.error());
    if (script) {
      const auto demanded = std::ranges::count_if(script->must, [](const Rule& rule) { return !rule.always; });
      fmt::print("{}: fine: {} drones, {} faults, {} rules{}\n", file, script->flight.drones, script->faults.size(),
                 demanded, check_sitl(*script) ? "" : "; in real time alone, by --program");
      continue;
    }
    fmt::print(stderr, "{}\n", script.error().message);
    ++wrong;
  }
  fmt::print("{} scripts, {} wrong\n", files->size(), wrong);
  return wrong > 0 ? exit_usage : 0;
}

}  // namespace

Act check(CommandLine& line) {
  const auto options = std::make_shared<CheckOptions>();
  Verb verb = line.verb("check", "Says all that is wrong with scripts, by file, line and key, without flying them");
  verb.option("SCRIPT", options->scripts, "files, folders, or names of scenarios and their groups").required();
  const Option real = verb.flag("--real", options->real, "whether they can be flown with the real processes");
  verb.option("--ledger", options->ledger, "of --real").needs(real).one_of({"embedded", "fabric"}).shows_default();
  verb.flag("--shim", options->shim, "of --real: drones behind the shim").needs(real);
  return {verb, [options] { return check_scripts(*options); }};
}

}  // namespace ledgerline::hil::verbs
