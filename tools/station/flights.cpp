#include <fmt/format.h>

#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"
#include "tools/station/core/show.hpp"
#include "tools/station/shell/options.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::station;

Status show(Station& station, bool as_json) {
  const auto drones = station.request({.target = "drones"});
  if (!drones) return drones.error();
  const auto missions = station.request({.target = "missions"});
  if (!missions) return missions.error();
  const auto event_list = station.request(events_since(0));
  if (!event_list) return event_list.error();
  const auto events = events_from(*event_list);
  if (!events) return events.error();
  const auto now_ms = now_ms_from(*event_list);
  if (!now_ms) return now_ms.error();
  const auto flown = active_flights_from(*drones, *missions, *events, *now_ms);
  if (!flown) return flown.error();
  if (as_json) {
    print_line(active_flights_json(*flown));
  } else if (flown->empty()) {
    print_line("Nothing is in the air, and no mission is in progress.");
  } else {
    fmt::print("{}", aligned(active_flight_rows(*flown)));
  }
  return done;
}

constexpr const char* about = "What a station flies now: missions in progress, and drones along a path or by hand.";
const std::string notes = R"(Examples:
  ledgerline flights
  ledgerline flights --json | jq .

since: seconds from the first take-off; "-" where it is longer ago than the 1,000 events that the station keeps.
)" + std::string(shared_notes);

}  // namespace

int ledgerline::command::flights(int argc, char** argv) {
  CommandLine line("ledgerline flights", about, notes);
  station::Options options;
  add_options(line, options);
  if (const auto end = line.parse(argc, argv)) return *end;
  return run(options, [&](Station& station, const Target&) { return show(station, options.json); });
}
