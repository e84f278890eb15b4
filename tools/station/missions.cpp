#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "common/base/file.hpp"
#include "common/base/utc.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "ground/mission/mission.hpp"
#include "tools/command/verbs.hpp"
#include "tools/station/core/show.hpp"
#include "tools/station/shell/options.hpp"
#include "tools/station/shell/signing.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::station;

struct VerbOptions {
  station::Options options;
  std::string file, name, id, approval_ground, until;
  double hours = 24;  // as [mission] approval_hours
  bool wait = false;
};

constexpr TimeNs wait_limit_ns = 3600 * ns_per_s;  // no battery lasts that long

Status print(const VerbOptions& verb_options, const std::string& body, const Result<std::string>& text) {
  if (verb_options.options.json) {
    print_line(body);
    return done;
  }
  if (!text) return text.error();
  fmt::print("{}", *text);
  return done;
}

Status list(Station& station, const VerbOptions& verb_options) {
  const auto body = station.request({.target = "missions"});
  if (!body) return body.error();
  const auto rows = mission_rows(*body);
  return print(verb_options, *body, rows ? Result<std::string>(aligned(*rows)) : rows.error());
}

Status add(Station& station, const VerbOptions& verb_options) {
  auto text = read_file(verb_options.file);
  if (!text) return text.error();
  const auto request = mission_to_add(verb_options.file, std::move(*text), verb_options.name);
  if (!request) return request.error();
  const auto body = station.request(*request);
  if (!body) return body.error();
  return print(verb_options, *body, mission_text(*body));
}

/// `station`: that is asked whether it has the mission, and its approvals; nullptr: nobody is.
Status digest(const VerbOptions& verb_options, Station* station) {
  const auto text = read_file(verb_options.file);
  if (!text) return text.error();
  const auto mission = mission_from(verb_options.file, *text, verb_options.name);
  if (!mission) return mission.error();
  const auto until_s = verb_options.until.empty() ? Result<std::int64_t>(0) : parse_time_s(verb_options.until);
  if (!until_s) return Error{"--until: " + until_s.error().message};
  const auto digests =
      digests_of(*mission, verb_options.approval_ground, *until_s, std::lround(3600 * verb_options.hours));
  if (!digests) return digests.error();
  if (station == nullptr) return print(verb_options, digests_json(*digests), digests_text(*digests));
  const auto body = station->request({.target = "missions"});
  if (!body) return body.error();
  const auto there = mission_with(*body, digests->digest);
  if (!there) return there.error();
  if (there->empty()) return Error{fmt::format("the station has no mission of the digest {}", digests->digest)};
  const auto shown = mission_text(*there);
  if (!shown) return shown.error();
  return print(verb_options, digests_json(*digests, *there), digests_text(*digests) + *shown);
}

Status act(Station& station, const VerbOptions& verb_options, const std::string& verb) {
  if (verb.empty()) return list(station, verb_options);
  if (verb == "add") return add(station, verb_options);
  if (verb == "digest") return digest(verb_options, &station);
  const std::string target = "missions/" + verb_options.id;
  if (verb == "show") {
    const auto body = station.request({.target = target});
    return body ? print(verb_options, *body, mission_text(*body)) : Status(body.error());
  }
  if (verb == "approve") {
    const auto approved = approve_and_wait(station, verb_options.id);
    if (!approved) return approved.error();
    return print(verb_options, R"({"accepted":true})", fmt::format("{}: approve: {}\n", verb_options.id, *approved));
  }
  const auto body =
      station.request(verb == "remove" ? station::Request{.method = "DELETE", .target = target, .anybodys = false}
                                       : mission_request(verb_options.id, verb));
  if (!body) return body.error();
  if (const Status printed = print(verb_options, *body, fmt::format("{}: {}: accepted\n", verb_options.id, verb));
      !printed || !verb_options.wait)
    return printed;
  return wait_until(station, target, verb_options.id, wait_limit_ns, is_flown);
}

constexpr const char* about =
    "The missions of a station: several drones, a path each, flown together (docs/station.md).\n"
    "Each is checked where the drones stand, approved by the digest of its text, and started.";
const std::string notes = R"(Examples:
  ledgerline missions
  ledgerline missions add survey.csv
  ledgerline missions approve 3f5a9c01d2e4
  ledgerline missions start 3f5a9c01d2e4
  ledgerline missions digest survey.csv --ground "Org2MSP CN=station" --until 2026-11-29T12:00:00Z

approve and withdraw are signed by who is signed in (ledgerline drones login); of approve, done is that it is on the ledger. Of the others done is
that the station has taken it; what comes of it the list shows, and `ledgerline alarms`. start --wait ends when the mission does.
)" + std::string(shared_notes);

}  // namespace

int ledgerline::command::missions(int argc, char** argv) {
  CommandLine line("ledgerline missions", about, notes);
  VerbOptions verb_options;
  add_options(line, verb_options.options);
  std::vector<Verb> verbs{line.verb("add", "Read one, and check it")};
  verbs.back().option("FILE", verb_options.file, "a mission, .json or .csv").required().existing_file();
  verbs.back().option("--name", verb_options.name, "of a mission in CSV; else the file's");
  verbs.push_back(
      line.verb("digest", "Print a file's digest and its approval's; of a station that is named, what it has of it"));
  Verb& digests = verbs.back();
  digests
      .option("FILE", verb_options.file,
              "a mission, .json or .csv, or what its ground keeps of it (ID.json, ID.record.json)")
      .required()
      .existing_file();
  digests.option("--name", verb_options.name, "of a mission in CSV; else the file's");
  Option until = digests.option("--until", verb_options.until, "end of the approval, as its words on the ledger say");
  until.needs(
      digests.option("--ground", verb_options.approval_ground, "whose approval: as the words end").needs(until));
  digests.option("--hours", verb_options.hours, "approval_hours of that ground").within(0.5, 8760.0).shows_default();
  for (const auto& [name, help] : std::initializer_list<std::pair<const char*, const char*>>{
           {"show", "Show one: its check, its approvals, how far it is"},
           {"approve", "Approve it, at this ground and for a while"},
           {"withdraw", "Withdraw one's own approval"},
           {"start", "Take off, and fly it"},
           {"pause", "All hover, and keep the rest"},
           {"resume", "Fly the rest"},
           {"land", "End it: all land"},
           {"remove", "Forget it"}}) {
    verbs.push_back(line.verb(name, help));
    verbs.back().option("ID", verb_options.id, "of a mission, as the list has it").required();
  }
  std::ranges::find(verbs, "start", &Verb::name)
      ->flag("--wait", verb_options.wait, "until it is flown, or ended before");
  line.verbs_are_optional();
  if (const auto end = line.parse(argc, argv)) return *end;
  std::string verb;
  for (const Verb& one : verbs) verb += one.is_given() ? one.name() : "";
  const bool names_station = !verb_options.options.url.empty() || !verb_options.options.config.empty();
  if (verb == "digest" && !names_station) return exit_code(digest(verb_options, nullptr));
  if (!verb_options.id.empty() && !ground::mission::is_name(verb_options.id))
    return fail(Error{"ID is a mission's, as `ledgerline missions` lists it"}, exit_usage);
  return run(verb_options.options, [&](Station& station, const Target&) { return act(station, verb_options, verb); });
}
