// ledgerline VERB ...: becomes the program in libexec that has the verb (verbs.hpp).
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/base/nearest_word.hpp"
#include "common/base/text.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"

namespace ledgerline {
/// Scripts for these shells, which ask `ledgerline __complete` for each word: completion.cpp, made by CMake.
extern const char* const bash_completion;
extern const char* const zsh_completion;
}  // namespace ledgerline

namespace {

using ledgerline::exit_usage;
using ledgerline::command::VerbRow;
using ledgerline::command::verbs;

std::filesystem::path program_of(const VerbRow& verb) {
  const std::filesystem::path root = ledgerline::build_or_prefix();
  return verb.program.empty() ? root / "bin" / ("ledgerline-" + std::string(verb.name))
                              : root / "libexec/ledgerline" / verb.program;
}

void help(std::FILE* to) {
  fmt::print(to,
             "Usage: ledgerline VERB [options]\n"
             "`ledgerline VERB --help` says what a verb does.\n");
  std::string_view group;
  for (const VerbRow& verb : verbs) {
    if (std::exchange(group, verb.group) != verb.group) fmt::print(to, "\n{}\n", verb.group);
    fmt::print(to, "  {:<14} {}\n", verb.name, verb.about);
  }
  fmt::print(to,
             "\nExamples:\n  ledgerline fly --drones 3\n  ledgerline control --config operator.toml stop tello1\n\n"
             "`ledgerline completion bash` (or zsh) prints what completes all this in that shell.\n");
}

int print_completion(const std::string& shell) {
  if (shell != "bash" && shell != "zsh") {
    std::fprintf(stderr, "Usage: ledgerline completion bash|zsh\n");
    return exit_usage;
  }
  std::fputs(shell == "bash" ? ledgerline::bash_completion : ledgerline::zsh_completion, stdout);
  return 0;
}

/// What can be typed first.
std::vector<std::string> first_words() {
  std::vector<std::string> words{"completion", "help", "version"};
  for (const VerbRow& verb : verbs) words.emplace_back(verb.name);
  std::ranges::sort(words);
  return words;
}

/// Becomes the program that has the verb; returns where that fails.
int run(const VerbRow& verb, const std::vector<std::string>& words) {
  const std::string program = program_of(verb);
  const bool is_service = verb.program.empty();  // which has no verb for its first argument
  std::vector<char*> arguments{const_cast<char*>(is_service ? program.c_str() : "ledgerline")};
  for (const std::string& word : std::span(words).subspan(is_service ? 1 : 0))
    arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  ::execv(program.c_str(), arguments.data());
  if (errno == ENOENT) {
    fmt::print(stderr,
               "ledgerline: the verb {} is in {}, which is not here: install its package, or in the source tree "
               "`cmake --build --preset release --target {}`\n",
               verb.name, program, std::filesystem::path(program).filename().string());
  } else {
    fmt::print(stderr, "ledgerline: {} cannot be run: {}\n", program, std::strerror(errno));
  }
  return ledgerline::exit_failed;
}

/// `words`: what was typed behind `ledgerline`, the last one perhaps in part.
int complete(const std::vector<std::string>& words) {
  if (words.size() <= 1) {
    const std::string typed = words.empty() ? "" : words.front();
    for (const std::string& word : first_words()) {
      if (word.starts_with(typed)) ledgerline::print_line(word);
    }
    return 0;
  }
  if (words.front() == "completion") return ledgerline::print_line("bash\nzsh"), 0;
  const auto verb = std::ranges::find(verbs, words.front(), &VerbRow::name);
  // What may stand behind a verb its own program knows.
  if (verb == verbs.end() || ::access(program_of(*verb).c_str(), X_OK) != 0) return 0;
  std::vector<std::string> question = words;
  question.insert(question.begin() + 1, ledgerline::completion_word);
  return run(*verb, question);
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> words(argv + 1, argv + argc);
  if (words.size() > 1 && words.front() == "help") {  // as `VERB --help`
    words.erase(words.begin());
    words.emplace_back("--help");
  }
  const std::string first = words.empty() ? "" : words.front();
  if (first == "--help" || first == "-h" || first == "help") return help(stdout), 0;
  if (first == "--version" || first == "version")
    return ledgerline::print_line(ledgerline::version_line("ledgerline")), 0;
  if (first == "completion") return print_completion(words.size() == 2 ? words[1] : "");
  if (first == ledgerline::completion_word) return complete({words.begin() + 1, words.end()});
  const auto verb = std::ranges::find(verbs, first, &VerbRow::name);
  if (verb != verbs.end()) return run(*verb, words);
  if (first.empty()) return help(stderr), exit_usage;
  const std::string near = ledgerline::did_you_mean("", first, first_words());
  fmt::print(stderr, "ledgerline: there is no verb \"{}\"; {}\n", ledgerline::printable(first),
             near.empty() ? "`ledgerline --help` lists them" : near);
  return exit_usage;
}
