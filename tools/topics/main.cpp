#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <optional>
#include <thread>

#include "common/base/file.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"
#include "tools/topics/show.hpp"

namespace {

using namespace ledgerline;

struct Options {
  std::string file;
  bool json = false, once = false;
  double period_s = 1;
};

Status show(const Options& options) {
  std::optional<topics::Status> before;
  do {
    const auto text = read_file(options.file);
    if (!text) return text.error();
    auto now = topics::parse_status(*text, options.file, monotonic_ns());
    if (!now) return now.error();
    if (options.json) {
      fmt::print("{}", *text);
    } else {
      const bool on_terminal = ::isatty(STDOUT_FILENO) == 1 && !options.once;
      fmt::print("{}{}", on_terminal ? "\x1b[H\x1b[J" : "", topics::table(before.value_or(*now), *now));
    }
    std::fflush(stdout);
    before = std::move(*now);
    for (const TimeNs until_ns = monotonic_ns() + from_seconds(options.period_s);
         !options.once && !stop_requested && monotonic_ns() < until_ns;) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  } while (!options.once && !stop_requested);
  return done;
}

constexpr const char* about = "Shows what each topic of a running bridge costs and loses, until SIGINT.";
constexpr const char* notes = R"(Examples:
  ledgerline topics /run/user/1000/bridge.json
  ledgerline topics --once --json bridge.json | jq .

messages: on the ledger (up), published on DDS (down); batches: transactions that carried some of them; age: from
DDS until committed (up), from the origin's stamp until here (down: between hosts as good as their clocks agree).
Exit codes: 0 done; 1 there is no such file, or its bridge is silent; 2 bad usage)";

}  // namespace

int ledgerline::command::topics(int argc, char** argv) {
  CommandLine line("ledgerline topics", about, notes);
  Options options;
  line.option("STATUS", options.file, "the file that [output] status of the bridge's config names").required();
  line.flag("--json", options.json, "the bridge's own status line instead of a table");
  line.flag("--once", options.once, "once");
  line.option("--period", options.period_s, "seconds").within(0.1, 3600.0);
  if (const auto end = line.parse(argc, argv)) return *end;
  catch_stop_signals();
  return exit_code(show(options));
}
