// ledgerline demo: `ledgerline fly` with a page and two operators, and explanations for a first-time viewer.
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"
#include "tools/launcher/machine.hpp"

namespace {

namespace fs = std::filesystem;
using namespace ledgerline;

constexpr const char* about =
    "Three simulated drones, a ledger, ground and its page, with two operators who sign in. Ctrl-C lands all and ends "
    "it.";
constexpr const char* notes = R"(Examples:
  ledgerline demo
  ledgerline demo --open
It is `ledgerline fly --drones 3 --shape manual --watch --operators alice,bob`, which has more options.
Exit codes: 0 ended, and nothing went wrong; 1 not so (a stopped drone is something that went wrong); 2 bad usage.)";

void tell(const fs::path& mission) {
  fmt::print(
      R"(Three simulated drones. When they are ready, two pass phrases and the page's address stand below. Then:
  1. Open the page, and sign in as alice with her pass phrase.
  2. Choose a drone, take control of it, take off. Keys on: W S A D and the arrows. Or draw a path, and fly it.
  3. Two drones at once: take control of tello1 and tello2, then the mission in
       {}
     on the page, or by the command line (its two settings stand below, too):
       ledgerline drones login --operator alice
       ledgerline drones acquire tello1 tello2
       ledgerline missions add FILE; ledgerline missions approve ID; ledgerline missions start ID
  4. In another window sign in as bob, and ask for a drone: alice hands it over.
Backspace on the page stops all. Ctrl-C here lands all, and ends it.

)",
      mission.string());
  std::fflush(stdout);
}

}  // namespace

int ledgerline::command::demo(int argc, char** argv) {
  CommandLine line("ledgerline demo", about, notes);
  bool opens = false;
  std::string out;
  line.flag("--open", opens, "Open the page in the browser, where there is xdg-open");
  line.option("--out", out, "Directory of the run; else chosen by the time");
  if (const auto end = line.parse(argc, argv)) return *end;
  {  // before all the words; the flight takes it again
    const auto lock =
        launcher::RunLock::acquire(launcher::RunLock::machine_file, fmt::format("process {}, a demo", ::getpid()));
    if (!lock) return fail(lock.error());
  }
  tell(build_or_prefix() / "share/ledgerline/examples/mission-two.csv");
  std::vector<std::string> words{programs_directory() / "ledgerline",
                                 "fly",
                                 "--drones",
                                 "3",
                                 "--shape",
                                 "manual",
                                 "--watch",
                                 "--operators",
                                 "alice,bob"};
  if (opens) words.emplace_back("--open");
  if (!out.empty()) words.insert(words.end(), {"--out", out});
  std::vector<char*> command;
  for (std::string& word : words) command.push_back(word.data());
  command.push_back(nullptr);
  ::execv(command.front(), command.data());
  return fail(Error{fmt::format("{} cannot be run: {}", words.front(), std::strerror(errno))});
}
