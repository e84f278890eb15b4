// ledgerline fault check, new and schema: scripts as files, without flying them.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "common/base/file.hpp"
#include "common/program/program.hpp"
#include "hil/fault/kinds/fault.hpp"
#include "hil/fault/own_code.hpp"
#include "hil/fault/real/real_script.hpp"
#include "hil/fault/report.hpp"
#include "hil/fault/scenarios.hpp"
#include "tools/fault/verbs.hpp"

namespace ledgerline::hil::verbs {
namespace {

struct CheckOptions {
  std::vector<std::string> scripts;
  bool real = false, shim = false;
  std::string ledger = "embedded";  // of --real
};

int check_scripts(const CheckOptions& options) {
  const auto files = scripts_named(options.scripts, build_or_prefix());
  if (!files) return usage_error(files.error().message);
  std::optional<RealStack> real;
  if (options.real) real = RealStack{options.ledger == "fabric", options.shim};
  std::size_t wrong = 0;
  for (const std::string& file : *files) {
    const auto text = read_file(file);
    const auto script = text ? check_script(*text, file, real) : Result<Script>(text.error());
    if (script) {
      const auto demanded = std::ranges::count_if(script->must, [](const Rule& rule) { return !rule.always; });
      fmt::print("{}: fine: {}, {}, {}{}\n", file, counted(static_cast<std::size_t>(script->flight.drones), "drone"),
                 counted(script->faults.size(), "fault"), counted(static_cast<std::size_t>(demanded), "rule"),
                 check_sitl(*script) ? "" : "; in real time alone, by --program");
      continue;
    }
    fmt::print(stderr, "{}\n", script.error().message);
    ++wrong;
  }
  fmt::print("{}, {} wrong\n", counted(files->size(), "script"), wrong);
  return wrong > 0 ? exit_usage : 0;
}

}  // namespace

Act check(CommandLine& line) {
  const auto options = std::make_shared<CheckOptions>();
  Verb verb = line.verb("check", "Says all that is wrong with scripts, by file, line and key, without flying them");
  verb.option("SCRIPT", options->scripts, "files, folders, names of scenarios and their groups, or all").required();
  const Option real = verb.flag("--real", options->real, "whether they can be flown with the real processes");
  verb.option("--ledger", options->ledger, "of --real").needs(real).one_of({"embedded", "fabric"}).shows_default();
  verb.flag("--shim", options->shim, "of --real: drones behind the shim").needs(real);
  return {verb, [options] { return check_scripts(*options); }};
}

namespace {

namespace fs = std::filesystem;

// As in file names everywhere; what stands in quotes and in comments of the script.
bool is_plain(const std::string& name) {
  constexpr const char* plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_.";
  return !name.empty() && name.front() != '.' && name.find_first_not_of(plain) == std::string::npos;
}

int write_first(const std::string& asked) {
  fs::path path = asked;
  if (path.extension() != ".toml") path += ".toml";
  const std::string name = path.stem().string();
  if (!is_plain(name))
    return usage_error(fmt::format("\"{}\": a script's name is of a-z, A-Z, 0-9, -, _ and .", asked));
  std::error_code error;
  if (fs::exists(fs::symlink_status(path, error)))
    return usage_error(fmt::format("{} is there already, and is left as it is", path.string()));
  if (const auto written = write_file(path.string(), first_script(name)); !written) return fail(written.error());
  fmt::print("{}: `ledgerline fault run {}` flies it\n", path.string(), path.string());
  return 0;
}

}  // namespace

Act make_new(CommandLine& line) {
  const auto name = std::make_shared<std::string>();
  Verb verb = line.verb("new", "Writes a script to begin with, with a word on each of its parts");
  verb.option("NAME", *name, "of the script; it becomes NAME.toml, which must not be there").required();
  return {verb, [name] { return write_first(*name); }};
}

Act schema(CommandLine& line) {
  Verb verb = line.verb(
      "schema", "Prints the JSON schema of a script, for editors: `#:schema ./FILE` in its first line names it");
  return {verb, [] {
            std::fputs(script_schema().c_str(), stdout);
            return 0;
          }};
}

}  // namespace ledgerline::hil::verbs
