#include "common/program/command_line.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <sstream>

#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/program/program.hpp"

namespace ledgerline {

std::string utf8_path_problem(const std::string& path) {
  if (path.empty()) return "";
  std::error_code error;
  const std::string absolute = std::filesystem::absolute(path, error).string();
  if (error) return "the working folder: " + error.message();
  return is_utf8(absolute) ? "" : printable(absolute) + " is no UTF-8, as configs and figures must be: choose another";
}

Option& Option::required(bool yes) { return option_->required(yes), *this; }
Option& Option::shows_default() { return option_->capture_default_str(), *this; }
Option& Option::within(int min, int max) { return option_->check(CLI::Range(min, max)), *this; }
Option& Option::within(double min, double max) { return option_->check(CLI::Range(min, max)), *this; }
Option& Option::positive() { return option_->check(CLI::PositiveNumber), *this; }
Option& Option::one_of(const std::vector<std::string>& names) { return option_->check(CLI::IsMember(names)), *this; }
Option& Option::one_of(std::initializer_list<int> numbers) {
  return option_->check(CLI::IsMember(std::vector<int>(numbers))), *this;
}
Option& Option::checked_by(const std::string& kind, std::function<std::string(const std::string&)> problem) {
  return option_->check(CLI::Validator(std::move(problem), kind)), *this;
}
Option& Option::existing_file() { return option_->check(CLI::ExistingFile), *this; }
Option& Option::existing_path() { return option_->check(CLI::ExistingPath), *this; }
Option& Option::utf8_path() {
  return option_->check(CLI::Validator([](const std::string& path) { return utf8_path_problem(path); }, "")), *this;
}
Option& Option::comma_list(int values) {
  option_->delimiter(',');
  if (values > 0) option_->expected(values);
  return *this;
}
Option& Option::one_at_a_time() { return option_->allow_extra_args(false), *this; }
Option& Option::needs(const Option& other) { return option_->needs(other.option_), *this; }
Option& Option::excludes(const Option& other) { return option_->excludes(other.option_), *this; }
bool Option::is_given() const { return option_->count() > 0; }

template <typename T>
Option Arguments::option(const std::string& name, T& value, const std::string& help) {
  return Option(app_->add_option(name, value, help));
}
template Option Arguments::option(const std::string&, int&, const std::string&);
template Option Arguments::option(const std::string&, unsigned&, const std::string&);
template Option Arguments::option(const std::string&, std::uint16_t&, const std::string&);
template Option Arguments::option(const std::string&, std::uint64_t&, const std::string&);
template Option Arguments::option(const std::string&, double&, const std::string&);
template Option Arguments::option(const std::string&, std::string&, const std::string&);
template Option Arguments::option(const std::string&, std::filesystem::path&, const std::string&);
template Option Arguments::option(const std::string&, std::vector<int>&, const std::string&);
template Option Arguments::option(const std::string&, std::vector<std::string>&, const std::string&);

Option Arguments::flag(const std::string& name, bool& value, const std::string& help) {
  return Option(app_->add_flag(name, value, help));
}

bool Arguments::is_given(const std::string& option) const { return app_->get_option(option)->count() > 0; }

bool Verb::is_given() const { return app_->parsed(); }
std::string Verb::name() const { return app_->get_name(); }

CommandLine::CommandLine(const std::string& name, const std::string& about, const std::string& notes)
    : Arguments(nullptr), name_(name), owned_(std::make_unique<CLI::App>(about, "ledgerline-" + name)) {
  app_ = owned_.get();
  app_->footer(notes);
  app_->set_version_flag("--version", version_line(name), "Print the version and end");
}

CommandLine::~CommandLine() = default;

Verb CommandLine::verb(const std::string& name, const std::string& about, const std::string& notes) {
  app_->require_subcommand(1);
  CLI::App* made = app_->add_subcommand(name, about);
  made->footer(notes);
  return Verb(made);
}

void CommandLine::verbs_are_optional() {
  app_->require_subcommand(0, 1);
  for (CLI::App* verb : app_->get_subcommands({})) verb->fallthrough();
}

namespace {
std::vector<const CLI::App*> verbs_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App*) { return true; });
}
}  // namespace

std::string CommandLine::completions(const std::vector<std::string>& words) const {
  const CLI::App* at = app_;
  const std::string typed = words.empty() ? "" : words.back();
  for (std::size_t i = 0; i + 1 < words.size(); ++i) {
    for (const CLI::App* verb : verbs_of(*at)) {
      if (verb->get_name() == words[i]) at = verb;
    }
  }
  const auto option = [&](const std::string& name) -> const CLI::Option* {
    const CLI::Option* own = at->get_option_no_throw(name);
    return own || !at->get_fallthrough() ? own : app_->get_option_no_throw(name);
  };
  if (words.size() > 1 && words[words.size() - 2].starts_with("--")) {
    const CLI::Option* before = option(words[words.size() - 2]);
    if (before && before->get_items_expected_max() > 0) return "";  // a value is typed
  }
  std::string found;
  const auto offer = [&](const std::string& word) {
    if (word.starts_with(typed)) found += word + "\n";
  };
  const auto offer_options = [&](const CLI::App* app) {
    for (const CLI::Option* one : app->get_options()) {
      for (const std::string& name : one->get_lnames()) offer("--" + name);
    }
  };
  if (typed.starts_with("-")) {
    offer_options(at);
    if (at != app_ && at->get_fallthrough()) offer_options(app_);
  } else {
    for (const CLI::App* verb : verbs_of(*at)) offer(verb->get_name());
  }
  return found;
}

std::optional<EarlyEnd> CommandLine::read(const std::vector<std::string>& arguments) {
  if (!arguments.empty() && arguments.front() == completion_word)
    return EarlyEnd{0, completions({arguments.begin() + 1, arguments.end()})};
  try {
    app_->parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));  // CLI11 takes the last one first
    return std::nullopt;
  } catch (const CLI::ParseError& end) {
    std::ostringstream text;
    const int code = app_->exit(end, text, text);
    for (const auto& [before, now] : renamed_) {
      if (code != 0 && std::ranges::find(arguments, before) != arguments.end())
        text << before << " is " << now << " now\n";
    }
    return EarlyEnd{code == 0 ? 0 : exit_usage, text.str()};
  }
}

std::optional<int> CommandLine::parse(int argc, char** argv) {
  report_uncaught_file_errors();
  report_lost_output();
  const auto end = read({argv + 1, argv + argc});
  if (!end) {
    init_log(name_);
    return std::nullopt;
  }
  std::fputs(end->text.c_str(), end->exit_code == 0 ? stdout : stderr);
  return end->exit_code;
}

}  // namespace ledgerline
