// ledgerline VERB ...: runs ledgerline-VERB, which lies beside this program or on PATH, as git does.
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/program/command_line.hpp"
#include "common/program/program.hpp"

namespace ledgerline {
/// Scripts for these shells, which ask `ledgerline __complete` for each word: completion.cpp, made by CMake.
extern const char* const bash_completion;
extern const char* const zsh_completion;
}  // namespace ledgerline

namespace {

namespace fs = std::filesystem;
using ledgerline::exit_usage;

const std::string prefix = "ledgerline-";

fs::path own_directory() {
  std::error_code error;
  return fs::read_symlink("/proc/self/exe", error).parent_path();
}

std::set<std::string> verbs_in(const fs::path& directory) {
  std::set<std::string> verbs;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(directory, error)) {
    const std::string name = entry.path().filename();
    if (name.rfind(prefix, 0) == 0 && ::access(entry.path().c_str(), X_OK) == 0)
      verbs.insert(name.substr(prefix.size()));
  }
  return verbs;
}

void help(std::FILE* to) {
  std::fprintf(
      to,
      "Usage: ledgerline VERB [options]\n"
      "Runs ledgerline-VERB; `ledgerline VERB --help` says what it does, `ledgerline --version` what version this "
      "is.\n\n"
      "Examples:\n  ledgerline fly --drones 3\n  ledgerline control --config operator.toml stop tello1\n\nVerbs:");
  for (const std::string& verb : verbs_in(own_directory())) std::fprintf(to, " %s", verb.c_str());
  std::fprintf(to, "\n\n`ledgerline completion bash` (or zsh) prints what completes all this in that shell.\n");
}

int print_completion(const std::string& shell) {
  if (shell != "bash" && shell != "zsh") {
    std::fprintf(stderr, "Usage: ledgerline completion bash|zsh\n");
    return exit_usage;
  }
  std::fputs(shell == "bash" ? ledgerline::bash_completion : ledgerline::zsh_completion, stdout);
  return 0;
}

/// What the first word may become.
void print_verbs(const std::string& typed) {
  std::set<std::string> words = verbs_in(own_directory());
  words.insert({"completion", "help", "version"});
  for (const std::string& word : words) {
    if (word.starts_with(typed)) std::printf("%s\n", word.c_str());
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::string verb = argc > 1 ? argv[1] : "";
  if (verb == "--help" || verb == "-h" || verb == "help") {
    help(stdout);
    return 0;
  }
  if (verb == "--version" || verb == "version") {
    ledgerline::print_line(ledgerline::version_line(""));
    return 0;
  }
  if (verb.empty() || verb.front() == '-' || verb.find('/') != std::string::npos) {
    help(stderr);
    return exit_usage;
  }
  if (verb == "completion") return print_completion(argc == 3 ? argv[2] : "");
  const bool completes = verb == ledgerline::completion_word;
  if (completes && argc <= 3) {
    print_verbs(argc == 3 ? argv[2] : "");
    return 0;
  }
  if (completes && std::string(argv[2]) == "completion") {
    std::printf("bash\nzsh\n");
    return 0;
  }
  // What may stand behind a verb its own program knows.
  const std::string name = prefix + (completes ? argv[2] : verb);
  std::vector<char*> command(argv + 1, argv + argc);
  if (completes) std::swap(command[0], command[1]);
  command[0] = const_cast<char*>(name.c_str());
  command.push_back(nullptr);
  ::execv((own_directory() / name).c_str(), command.data());
  if (errno == ENOENT) ::execvp(name.c_str(), command.data());
  if (completes) return 0;
  if (errno != ENOENT) {
    std::fprintf(stderr, "ledgerline: %s cannot be run: %s\n", name.c_str(), std::strerror(errno));
    return 1;
  }
  std::fprintf(stderr, "ledgerline: there is no verb \"%s\"\n\n", verb.c_str());
  help(stderr);
  return exit_usage;
}
