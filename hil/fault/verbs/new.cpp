// ledgerline fault new: a script to begin with.
#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "common/base/file.hpp"
#include "common/program/program.hpp"
#include "hil/fault/script.hpp"
#include "hil/fault/verbs/verbs.hpp"

namespace ledgerline::hil::verbs {
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

}  // namespace ledgerline::hil::verbs
