#include <fmt/format.h>

#include <string>
#include <vector>

#include "common/base/file.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "ground/mission/mission.hpp"
#include "tools/station/core/show.hpp"
#include "tools/station/shell/options.hpp"
#include "tools/station/shell/signing.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::station;

struct Wish {
  station::Options options;
  std::string file, name, id;
};

Status print(const Wish& wish, const std::string& body, const Result<std::string>& text) {
  if (wish.options.json) {
    print_line(body);
    return done;
  }
  if (!text) return text.error();
  fmt::print("{}", *text);
  return done;
}

Status list(Station& station, const Wish& wish) {
  const auto body = station.ask({.target = "missions"});
  if (!body) return body.error();
  const auto rows = mission_rows(*body);
  return print(wish, *body, rows ? Result<std::string>(aligned(*rows)) : rows.error());
}

Status add(Station& station, const Wish& wish) {
  auto text = read_file(wish.file);
  if (!text) return text.error();
  const auto request = mission_to_add(wish.file, std::move(*text), wish.name);
  if (!request) return request.error();
  const auto body = station.ask(*request);
  if (!body) return body.error();
  return print(wish, *body, mission_text(*body));
}

Status act(Station& station, const Wish& wish, const std::string& verb) {
  if (verb.empty()) return list(station, wish);
  if (verb == "add") return add(station, wish);
  const std::string target = "missions/" + wish.id;
  if (verb == "show") {
    const auto body = station.ask({.target = target});
    return body ? print(wish, *body, mission_text(*body)) : Status(body.error());
  }
  if (verb == "approve") {
    if (auto approved = approve_and_wait(station, wish.id); !approved) return approved;
    return print(wish, R"({"accepted":true})", fmt::format("{}: approve: done\n", wish.id));
  }
  const auto body = station.ask(verb == "remove" ? Request{.method = "DELETE", .target = target, .anybodys = false}
                                                 : mission_request(wish.id, verb));
  if (!body) return body.error();
  return print(wish, *body, fmt::format("{}: {}: accepted\n", wish.id, verb));
}

constexpr const char* about =
    "The missions of a station: several drones, a path each, flown together (docs/missions.md).\n"
    "Each is checked where the drones stand, approved by the digest of its text, and started.";
const std::string notes = R"(Examples:
  ledgerline missions
  ledgerline missions add survey.csv
  ledgerline missions approve 3f5a9c01d2e4
  ledgerline missions start 3f5a9c01d2e4

approve and withdraw are signed by who is signed in (ledgerline drones login); of approve, done is that it is on the ledger. Of the others done is
that the station has taken it; what comes of it the list shows, and `ledgerline alarms`.
)" + std::string(shared_notes);

}  // namespace

int main(int argc, char** argv) {
  CommandLine line("missions", about, notes);
  Wish wish;
  add_options(line, wish.options);
  std::vector<Verb> verbs{line.verb("add", "Read one, and check it")};
  verbs.back().option("FILE", wish.file, "a mission, .json or .csv").required().existing_file();
  verbs.back().option("--name", wish.name, "of a mission in CSV; else the file's");
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
    verbs.back().option("ID", wish.id, "of a mission, as the list has it").required();
  }
  line.verbs_are_optional();
  if (const auto end = line.parse(argc, argv)) return *end;
  std::string verb;
  for (const Verb& one : verbs) verb += one.given() ? one.name() : "";
  if (!wish.id.empty() && !ground::mission::is_name(wish.id))
    return fail(Error{"ID is a mission's, as `ledgerline missions` lists it"}, exit_usage);
  return run(wish.options, [&](Station& station, const Target&) { return act(station, wish, verb); });
}
