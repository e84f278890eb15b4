#include "common/program/command_line.hpp"
#include "onboard/roudi/service.hpp"

namespace {

constexpr const char* about =
    "Shared memory between link and agent: iceoryx' RouDi with small pools. One runs per machine.";
constexpr const char* notes = R"(Examples:
  ledgerline-roudi                 serve until SIGTERM
A line {"leaked":N} on standard output says that N chunks were lost with processes that were killed.
Exit codes: 0 stopped by a signal, 1 cannot serve or write the summary, 2 bad usage)";

}  // namespace

int main(int argc, char** argv) {
  ledgerline::CommandLine line("roudi", about, notes);
  std::string summary;
  line.option("--summary", summary, "Write here at the end: chunks in use by size, and how many were lost");
  if (const auto end = line.parse(argc, argv)) return *end;
  ledgerline::roudi::serve(summary);
}
