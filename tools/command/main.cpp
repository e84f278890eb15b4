// ledgerline VERB ...: runs ledgerline-VERB, which lies beside this program or on PATH, as git does.
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "common/program/program.hpp"

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
  std::fprintf(to, "\n");
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
  const std::string name = prefix + verb;
  std::vector<char*> command(argv + 1, argv + argc);
  command[0] = const_cast<char*>(name.c_str());
  command.push_back(nullptr);
  ::execv((own_directory() / name).c_str(), command.data());
  if (errno == ENOENT) ::execvp(name.c_str(), command.data());
  if (errno != ENOENT) {
    std::fprintf(stderr, "ledgerline: %s cannot be run: %s\n", name.c_str(), std::strerror(errno));
    return 1;
  }
  std::fprintf(stderr, "ledgerline: there is no verb \"%s\"\n\n", verb.c_str());
  help(stderr);
  return exit_usage;
}
