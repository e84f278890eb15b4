#include <fmt/format.h>

#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"
#include "tools/station/core/show.hpp"
#include "tools/station/shell/options.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::station;

struct VerbOptions {
  station::Options options;
  bool watch = false, all = false;
};

Status show(Station& station, const VerbOptions& verb_options) {
  if (verb_options.watch) catch_stop_signals();
  std::uint64_t number = 0;
  do {
    const auto body = station.request(events_since(number));
    if (!body) return body.error();
    // A station that restarted counts from 1: for long there would be nothing after `number`.
    if (station.connections() > 1) return Error{"the station closed the connection: it may have restarted"};
    const auto events = events_from(*body);
    if (!events) return events.error();
    const auto now_ms = now_ms_from(*body);
    if (!now_ms) return now_ms.error();
    if (verb_options.options.json && (number == 0 || !events->empty())) print_line(*body);
    for (const ShownEvent& event : *events) {
      number = event.number;
      if (!verb_options.options.json && (verb_options.all || event.level != "info"))
        print_line(event_line(event, time_of_day(event.t_ms, *now_ms)));
    }
    if (verb_options.watch) rest(ns_per_s);
  } while (verb_options.watch && !stop_requested);
  return done;
}

constexpr const char* about =
    "The alarms and warnings of a station so far, those that are over among them; oldest first.";
const std::string notes = R"(Examples:
  ledgerline alarms
  ledgerline alarms --watch
  ledgerline alarms --all --watch >> flight.log

The station keeps its newest 1,000 events. Times are this computer's. --json is the station's answer as it is, with every level.
)" + std::string(shared_notes);

}  // namespace

int ledgerline::command::alarms(int argc, char** argv) {
  CommandLine line("ledgerline alarms", about, notes);
  VerbOptions verb_options;
  add_options(line, verb_options.options);
  line.flag("--watch", verb_options.watch, "go on with what comes, until SIGINT");
  line.flag("--all", verb_options.all, "info as well");
  if (const auto end = line.parse(argc, argv)) return *end;
  return run(verb_options.options, [&](Station& station, const Target&) { return show(station, verb_options); });
}
