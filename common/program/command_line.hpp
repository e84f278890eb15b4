#pragma once
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace ledgerline {

/// What is wrong with a path that goes into configs (TOML) or figures (JSON): it must be UTF-8, and so must the working
/// folder that it counts from. Empty: nothing.
std::string utf8_path_problem(const std::string& path);

/// One option of a command line, to say more of it.
class Option {
 public:
  explicit Option(CLI::Option* option) : option_(option) {}

  Option& required(bool yes = true);
  Option& shows_default();
  Option& within(int min, int max);
  Option& within(double min, double max);
  Option& positive();
  Option& one_of(const std::vector<std::string>& names);
  Option& one_of(std::initializer_list<int> numbers);
  /// `kind`: what help calls its value; `problem`: what is wrong with a text, empty: nothing.
  Option& checked_by(const std::string& kind, std::function<std::string(const std::string&)> problem);
  Option& existing_file();
  Option& existing_path();
  /// As utf8_path_problem().
  Option& utf8_path();
  /// Of a list: commas stand between its values, and there must be so many (0: one or more).
  Option& comma_list(int values = 0);
  /// Of a list: one value each time that it is given.
  Option& one_at_a_time();
  Option& needs(const Option& other);
  Option& excludes(const Option& other);

  /// Few need it: shown by `--help-all` alone.
  Option& in_help_all();

  bool is_given() const;

 private:
  CLI::Option* option_;
};

/// What can be asked of a program, or of one of its verbs. Values are written where the references say, which must
/// outlive the parsing.
class Arguments {
 public:
  /// T: int, unsigned, std::uint16_t, std::uint64_t, double, std::string, a path, or a vector of int or std::string. A
  /// name without "--" is a place on the line.
  template <typename T>
  Option option(const std::string& name, T& value, const std::string& help);
  /// "!--no-x" makes `value` false.
  Option flag(const std::string& name, bool& value, const std::string& help);
  /// After the parsing: was this option there?
  bool is_given(const std::string& option) const;

 protected:
  explicit Arguments(CLI::App* app) : app_(app) {}
  CLI::App* app_;
};

class Verb : public Arguments {
 public:
  explicit Verb(CLI::App* app) : Arguments(app) {}
  using Arguments::is_given;
  bool is_given() const;
  std::string name() const;
};

/// The first word of a question for completions.
inline constexpr const char* completion_word = "__complete";

/// A program's end before its work: help, its version, or what is wrong with what it was given.
struct EarlyEnd {
  int exit_code = 0;
  std::string text;
};

/// The command line of a program: its options and verbs, the help that they make, and `--version`. Every program
/// has one, so that each answers --help and --version with 0, and what it does not know with 2. CLI11 does the work, in
/// the .cpp alone: programs do not pay for it. One thread.
class CommandLine : public Arguments {
 public:
  /// `name` as it is typed, "ledgerline audit" or "ledgerline-agent"; `about` stands above the options in help, `notes`
  /// below them.
  CommandLine(const std::string& name, const std::string& about, const std::string& notes);
  ~CommandLine();

  /// With verbs, one of them must be given.
  Verb verb(const std::string& name, const std::string& about, const std::string& notes = "");
  /// After the verbs: without one the program does something, too, and its own options may stand behind a verb as well.
  void verbs_are_optional();

  /// After a rename: an error about a line with the old verb or option names the new one.
  void renamed(const std::string& before, const std::string& now) { renamed_.emplace_back(before, now); }

  /// nullopt: the values are there, and the program goes on. `__complete WORD... TYPED`, which shells ask
  /// (`ledgerline completion`), is an early end with what TYPED may become, a line each: verbs, or options if it begins
  /// with "-".
  std::optional<EarlyEnd> read(const std::vector<std::string>& arguments);
  /// read() for main(): prints an early end, and returns its exit code; else starts the log in the program's name.
  std::optional<int> parse(int argc, char** argv);

 private:
  std::string completions(const std::vector<std::string>& words) const;

  std::string name_;
  std::unique_ptr<CLI::App> owned_;
  std::vector<std::pair<std::string, std::string>> renamed_;
};

/// main() of an executable with several verbs: the first argument says which, and is its `argv[0]`.
int run_verb(int argc, char** argv, const std::map<std::string, int (*)(int, char**)>& verbs);

}  // namespace ledgerline
