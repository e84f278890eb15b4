#include "common/program/command_line.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <set>
#include <sstream>
#include <utility>

#include "common/base/log.hpp"
#include "common/base/nearest_word.hpp"
#include "common/base/text.hpp"
#include "common/program/program.hpp"

namespace ledgerline {
namespace {

constexpr const char* help_all = "--help-all";
constexpr const char* more_options = "More options";

/// CLI11's own lists other options in the order of their addresses, which differs from run to run.
class OrderedHelp : public CLI::Formatter {
  /// Without what "!--no-x" sets its value to: "--no-x{false}" reads as something to type.
  std::string make_option_name(const CLI::Option* option, bool is_positional) const override {
    constexpr std::string_view value = "{false}";
    std::string name = CLI::Formatter::make_option_name(option, is_positional);
    if (const auto at = name.find(value); at != std::string::npos) name.erase(at, value.size());
    return name;
  }
  /// One that may also stand without its name is required once, not twice.
  std::string make_option(const CLI::Option* option, bool is_positional) const override {
    std::string text = Formatter::make_option(option, is_positional);
    const std::string required = " REQUIRED";
    const auto at = text.find(required);
    if (is_positional || !option->get_positional() || at == std::string::npos) return text;
    std::string other = " or " + option->get_name(true);
    other.resize(std::max(other.size(), required.size()), ' ');
    const std::size_t blanks = std::min(text.find_first_not_of(' ', at + required.size()), text.size());
    const std::size_t room = blanks - at - 1;  // one blank stays before the description
    return text.replace(at, std::min(other.size(), std::max(room, required.size())), other);
  }
  std::string make_option_opts(const CLI::Option* option) const override {
    std::string text;
    if (option->get_type_size() != 0) {
      if (!option->get_type_name().empty()) text += " " + option->get_type_name();
      if (!option->get_default_str().empty()) text += "=" + option->get_default_str();
      if (option->get_expected_max() == CLI::detail::expected_max_vector_size)
        text += " ...";
      else if (option->get_expected_min() > 1)
        text += " x " + std::to_string(option->get_expected());
      if (option->get_required()) text += " REQUIRED";
    }
    return text + list(" Needs:", option->get_needs()) + list(" Excludes:", option->get_excludes());
  }
  static std::string list(const std::string& what, const std::set<CLI::Option*>& others) {
    std::set<std::string> names;
    for (const CLI::Option* other : others) {
      if (!other->get_group().empty()) names.insert(other->get_name());  // else it is hidden
    }
    std::string text = names.empty() ? "" : what;
    for (const std::string& name : names) text += " " + name;
    return text;
  }
};

std::vector<CLI::App*> verbs_of(CLI::App& app) { return app.get_subcommands({}); }

/// Without the dashes, which each option has: --all is not near --url.
std::string nearest_option(const std::string& typed, std::vector<std::string> known) {
  for (std::string& name : known) name.erase(0, 2);
  const std::string near = nearest_word(typed.substr(2), known);
  return near.empty() ? "" : "--" + near;
}

/// "did you mean --laps?" for the first word that the program does not have; empty: all are known, or none is near.
std::string suggestion(CLI::App& app, const std::vector<std::string>& arguments) {
  std::vector<std::string> names, options;
  const auto add_options = [&](CLI::App& of) {
    for (const CLI::Option* one : of.get_options()) {
      for (const std::string& name : one->get_lnames()) options.push_back("--" + name);
    }
  };
  add_options(app);
  for (CLI::App* verb : verbs_of(app)) {
    names.push_back(verb->get_name());
    if (std::ranges::find(arguments, verb->get_name()) != arguments.end()) add_options(*verb);
  }
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::string word = arguments[i].substr(0, arguments[i].find('='));
    const bool is_option = word.starts_with("--");
    if (!is_option && i > 0) continue;  // a value
    const std::vector<std::string>& known = is_option ? options : names;
    if (std::ranges::find(known, word) != known.end()) continue;
    const std::string near = is_option ? nearest_option(word, known) : nearest_word(word, known);
    return near.empty() ? "" : "did you mean " + near + "?\n";
  }
  return "";
}

/// "there is no "nofile": run, list" of a first word that is no verb where one is meant, or is missing; empty: it is
/// not that.
std::string verb_problem(CLI::App& app) {
  if (verbs_of(app).empty() || !app.get_subcommands().empty()) return "";
  const std::vector<std::string> left = app.remaining();
  if (left.empty() && app.get_require_subcommand_min() == 0) return "";
  if (!left.empty() && left.front().starts_with("-")) return "";
  std::string text = left.empty() ? "say what to do:" : "there is no \"" + printable(left.front()) + "\":";
  for (const CLI::App* verb : verbs_of(app)) text += (text.ends_with(':') ? " " : ", ") + verb->get_name();
  return text;
}

}  // namespace

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
Option& Option::in_help_all() { return option_->group(more_options), *this; }
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
    : Arguments(nullptr), name_(name), owned_(std::make_unique<CLI::App>(about, name)) {
  app_ = owned_.get();
  app_->formatter(std::make_shared<OrderedHelp>());  // verbs take it over
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

std::string CommandLine::completions(const std::vector<std::string>& words) const {
  CLI::App* at = app_;
  const std::string typed = words.empty() ? "" : words.back();
  for (std::size_t i = 0; i + 1 < words.size(); ++i) {
    for (CLI::App* verb : verbs_of(*at)) {
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
  const auto has_more = [this] {
    return std::ranges::any_of(app_->get_options(), [](const auto* one) { return one->get_group() == more_options; });
  };
  std::vector<std::string> words(arguments.rbegin(), arguments.rend());  // CLI11 takes the last one first
  const auto asks = [&](const char* option) { return std::ranges::find(words, option) != words.end(); };
  if (has_more() && asks(help_all)) {
    words = {"--help"};
  } else if (has_more() && (asks("--help") || asks("-h"))) {
    // Not before: errors would do without the names of what is hidden.
    for (CLI::Option* one : app_->get_options()) {
      if (one->get_group() == more_options) one->group("");
    }
    app_->footer("More options: " + name_ + " " + help_all + "\n\n" + app_->get_footer());
  }
  const auto end_with = [&](const CLI::ParseError& end) {
    std::ostringstream text;
    const int code = app_->exit(end, text, text);
    for (const auto& [before, now] : renamed_) {
      if (code != 0 && std::ranges::find(arguments, before) != arguments.end())
        text << before << " is " << now << " now\n";
    }
    if (code != 0) text << suggestion(*app_, arguments);
    return EarlyEnd{code == 0 ? 0 : exit_usage, text.str()};
  };
  const auto end_without_verb = [&](const std::string& problem) {
    return end_with(CLI::ParseError(problem, CLI::ExitCodes::RequiredError));
  };
  try {
    app_->parse(words);
    return std::nullopt;
  } catch (const CLI::RequiredError& end) {
    const std::string problem = verb_problem(*app_);
    return problem.empty() ? end_with(end) : end_without_verb(problem);
  } catch (const CLI::ExtrasError&) {
    if (const std::string problem = verb_problem(*app_); !problem.empty()) return end_without_verb(problem);
    std::vector<std::string> unexpected = app_->remaining(true);
    std::ranges::reverse(unexpected);  // CLI11 lists the last one first
    return end_with(CLI::ExtrasError(unexpected));
  } catch (const CLI::ParseError& end) {
    return end_with(end);
  }
}

std::optional<int> CommandLine::parse(int argc, char** argv) {
  report_uncaught_file_errors();
  report_lost_output();
  const auto end = read({argv + 1, argv + argc});
  if (!end) {
    const std::string prefix = "ledgerline ";  // or "ledgerline-": logs do without
    init_log(name_.size() > prefix.size() ? name_.substr(prefix.size()) : name_);
    return std::nullopt;
  }
  std::fputs(end->text.c_str(), end->exit_code == 0 ? stdout : stderr);
  return end->exit_code;
}

int run_verb(int argc, char** argv, const std::map<std::string, int (*)(int, char**)>& verbs) {
  const auto verb = argc > 1 ? verbs.find(argv[1]) : verbs.end();
  if (verb != verbs.end()) return verb->second(argc - 1, argv + 1);
  std::fputs("This is started by `ledgerline VERB`; here are:", stderr);
  for (const auto& [name, main] : verbs) std::fprintf(stderr, " %s", name.c_str());
  std::fputs("\n", stderr);
  return exit_usage;
}

}  // namespace ledgerline
