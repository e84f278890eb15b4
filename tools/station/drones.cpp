#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
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

constexpr TimeNs watch_every_ns = 500 * ns_per_ms;

struct VerbOptions {
  station::Options options;
  bool watch = false, all = false, land = false, yes = false;
  std::vector<std::string> names;
  std::string drone, path_file, msp, subject, name, pass_phrase_file;
  unsigned priority = 0;
  bool wait = false;
};

constexpr TimeNs wait_limit_ns = 60 * ns_per_s;  // the slowest landing takes a third of it

Status show(Station& station, const VerbOptions& verb_options) {
  if (verb_options.watch) catch_stop_signals();
  Rows before;
  do {
    const auto body = station.request({.target = "drones"});
    if (!body) return body.error();
    const auto rows = drone_rows(*body);
    if (!rows) return rows.error();
    if (Rows now = settled(*rows); now != before) {
      before = std::move(now);
      if (verb_options.options.json)
        print_line(*body);
      else if (verb_options.watch)
        print_refreshed(aligned(*rows));
      else
        fmt::print("{}", aligned(*rows));
    }
    if (verb_options.watch) rest(watch_every_ns);
  } while (verb_options.watch && !stop_requested);
  return done;
}

/// All of them, whatever came of those before: a stop that fails must not keep another drone in the air.
Status each(const std::vector<std::string>& names, const std::function<Status(const std::string&)>& act) {
  if (names.size() == 1) return act(names.front());
  std::size_t failed = 0;
  for (const std::string& name : names) {
    const Status acted = act(name);
    if (acted) continue;
    ++failed;
    spdlog::error("{}", of_drone(name, acted.error().message));
  }
  if (failed == 0) return done;
  return Error{fmt::format("{} of {} drones: not done", failed, names.size())};
}

Status send(Station& station, const VerbOptions& verb_options, const std::string& verb, const station::Request& request,
            const std::string& whom) {
  const auto body = station.request(request);
  if (!body) return body.error();
  print_line(verb_options.options.json ? *body : fmt::format("{}: {}: accepted", whom, verb));
  return done;
}

Status fly_path(Station& station, const VerbOptions& verb_options) {
  const auto csv = read_file(verb_options.path_file);
  if (!csv) return csv.error();
  auto body = path_body(*csv, verb_options.path_file, verb_options.land);
  if (!body) return body.error();
  const std::string& name = verb_options.names.front();
  return send(station, verb_options, "path", drone_request(name, "path", std::move(*body)), name);
}

/// Whom hand_over and deny are about: who is named, else the only one who has requested the drone.
Result<std::string> requester_body(Station& station, const VerbOptions& verb_options) {
  if (!verb_options.msp.empty()) return to_body(verb_options.msp, verb_options.subject);
  const auto drones = station.request({.target = "drones"});
  if (!drones) return drones.error();
  const auto requester = only_requester(*drones, verb_options.names.front());
  if (!requester) return requester.error();
  return to_body(requester->msp_id, requester->subject);
}

Status sign(Station& station, const VerbOptions& verb_options, const std::string& verb) {
  std::string body = "{}";
  if (verb == "hand_over" || verb == "deny") {
    auto about = requester_body(station, verb_options);
    if (!about) return about.error();
    body = std::move(*about);
  }
  if ((verb == "acquire" || verb == "request") && verb_options.priority > 0)
    body = fmt::format(R"({{"priority":{}}})", verb_options.priority);
  if (verb == "release" && verb_options.yes) body = R"({"confirmed":true})";
  return each(verb_options.names, [&](const std::string& name) {
    auto signed_call = call_and_wait(station, name, verb, body);
    if (signed_call)
      print_line(verb_options.options.json ? R"({"accepted":true})" : fmt::format("{}: {}: done", name, verb));
    return signed_call;
  });
}

Status log_in(Station& station, const Target& target, const VerbOptions& verb_options) {
  const auto phrase = verb_options.pass_phrase_file.empty() ? ask_secret("Pass phrase of " + verb_options.name)
                                                            : read_secret(verb_options.pass_phrase_file);
  if (!phrase) return phrase.error();
  const auto session = open_session(station, target, verb_options.name, *phrase);
  if (!session) return session.error();
  fmt::print("{} is signed in as {}; the session is in {}\n", session->name, session->identity, target.session_file);
  fmt::print(
      "A session of which nothing is heard for [service] session_idle_s ends, and what it holds lands: "
      "`ledgerline drones --watch` keeps it.\n");
  return done;
}

Status log_out(Station& station, const Target& target) {
  if (auto ended = close_session(station, target); !ended) return ended;
  print_line("Signed out. What was held lands and is given back.");
  return done;
}

/// Of those for which it makes sense; the error says that there is none.
Result<std::vector<std::string>> names_of_all(Station& station, const std::string& verb) {
  const std::map<std::string, const char*> none{{"clear_stop", "no drone is stopped"},
                                                {"acquire", "each drone is held by somebody: request it"},
                                                {"request", "no drone is held by somebody else"},
                                                {"release", "you hold no drone"},
                                                {"land", "no drone is in the air"}};
  std::string self;
  if (verb == "request" || verb == "release") {
    const auto operators = station.request({.target = "operators"});
    if (!operators) return operators.error();
    auto identity = identity_signed_in(*operators);
    if (!identity) return identity.error();
    if (identity->empty())
      return Error{"nobody is signed in: `ledgerline drones login`, or where nobody signs in, `ledgerline control`"};
    self = std::move(*identity);
  }
  const auto body = station.request({.target = "drones"});
  if (!body) return body.error();
  auto names = drones_for(*body, verb, self);
  if (names && names->empty()) return Error{none.at(verb)};
  return names;
}

Status act(Station& station, const Target& target, const VerbOptions& verb_options, const std::string& verb) {
  if (verb.empty()) return show(station, verb_options);
  if (verb == "login") return log_in(station, target, verb_options);
  if (verb == "logout") return log_out(station, target);
  if (verb == "path") return fly_path(station, verb_options);
  if (verb_options.all && verb != "stop" && verb != "cut") {
    const auto names = names_of_all(station, verb);
    if (!names)
      return Error{names.error().message +
                   (verb == "land" ? " (nothing was sent; stop --all asks nothing first)" : "")};
    VerbOptions of_all = verb_options;
    of_all.all = false;
    of_all.names = *names;
    return act(station, target, of_all, verb);
  }
  if (is_signed_call(verb)) return sign(station, verb_options, verb);
  if (verb_options.all)
    return send(station, verb_options, verb, verb == "cut" ? cut_all(verb_options.yes) : stop_all(), "all");
  const std::string body = verb == "cut" && verb_options.yes ? R"({"confirmed":true})" : "{}";
  return each(verb_options.names, [&](const std::string& name) {
    return send(station, verb_options, verb, drone_request(name, verb, body), name);
  });
}

Status act_and_wait(Station& station, const Target& target, const VerbOptions& verb_options, const std::string& verb) {
  const auto is_there = [&](std::string_view body) { return all_arrived(body, verb_options.names, verb); };
  if (verb_options.wait && verb == "takeoff") {
    const auto newest = newest_event(station);
    if (!newest) return newest.error();
    if (const Status acted = act(station, target, verb_options, verb); !acted) return acted;
    return wait_or_hear(station, verb_options.names, "no take-off: ", *newest, verb, wait_limit_ns, is_there);
  }
  // Nothing is asked before what brings a drone down.
  const Status acted = act(station, target, verb_options, verb);
  if (!acted || !verb_options.wait) return acted;
  return wait_until(station, "drones", verb, wait_limit_ns, is_there);
}

/// Empty: what was asked for makes sense.
std::string nonsense(const VerbOptions& verb_options, const std::string& verb, bool is_for_many) {
  if (verb_options.wait && !has_an_end(verb)) return "--wait goes with takeoff, land, stop and cut";
  if (verb_options.msp.empty() != verb_options.subject.empty()) return "--msp and --subject go together";
  if (!verb.empty() && verb_options.watch) return "--watch goes with the table alone";
  if (is_for_many && verb_options.names.empty() != verb_options.all) return "either names, or --all";
  for (const std::string& name : verb_options.names) {
    if (!ground::mission::is_name(name)) return fmt::format("\"{}\" cannot be a drone's name", name);
  }
  return "";
}

constexpr const char* about =
    "Shows the station's drones, or commands one of them: a client of its API (docs/station.md).\n"
    "Where the station has operators, one signs in first: `ledgerline drones login --operator alice`.";
const std::string notes = R"(Examples:
  ledgerline drones --url http://127.0.0.1:8800 --token-file page.token
  ledgerline drones --watch
  ledgerline drones takeoff tello1 tello2
  ledgerline drones path tello1 way.csv --land
  ledgerline drones stop --all
  ledgerline drones clear_stop --all

takeoff, land, pause ...: done is that the station has taken it; what comes of it the table and `ledgerline alarms` show.
With --wait, takeoff is done when the drones fly, and land, stop and cut when they are on the ground.
acquire, release, request, clear_stop, hand_over, deny: done is that the ledger has it.
)" + std::string(shared_notes);

constexpr const char* wait_help = "until it has come to that, at most 60 s";

/// In the order in which help lists them.
struct Verbs {
  Verbs(CommandLine& line, VerbOptions& verb_options) {
    with_names(line, verb_options, "takeoff", "Take off").required();
    with_wait(verb_options);
    for_many(line, verb_options, "land", "Land", "every drone in the air");
    with_wait(verb_options);
    for (const auto& [name, help] :
         std::initializer_list<std::pair<const char*, const char*>>{{"pause", "Hover, and keep the rest of the path"},
                                                                    {"resume", "Fly the rest of the path"},
                                                                    {"return", "Fly to where it took off"}})
      with_names(line, verb_options, name, help).required();
    for_many(line, verb_options, "clear_stop", "Clear the stop, so that it may take off again",
             "every drone that is stopped");
    for_many(line, verb_options, "acquire", "Take the lease: take control", "every drone that nobody holds");
    with_priority(verb_options);
    for_many(line, verb_options, "request", "Ask its holder for the lease", "every drone that others hold");
    with_priority(verb_options);
    for_many(line, verb_options, "release", "Give the lease back", "every drone that you hold");
    all.back().flag("--yes", verb_options.yes, "of a drone in the air, too: it lands by its failsafe");
    for_many(line, verb_options, "stop", "Stop: land, and stay there until somebody clears it", "every drone");
    with_wait(verb_options);
    for_many(line, verb_options, "cut", "Stop with motors off, at once", "every drone");
    with_wait(verb_options);
    all.back().flag("--yes", verb_options.yes, "of a drone in the air, too: it drops");
    for (const auto& [name, help] : std::initializer_list<std::pair<const char*, const char*>>{
             {"hand_over", "Give the lease to one who has asked for it"}, {"deny", "End somebody's request"}}) {
      one_drone(line, verb_options, name, help);
      all.back().option("--msp", verb_options.msp, "whose, where several have: Org2MSP, with --subject");
      all.back().option("--subject", verb_options.subject, "CN=..., with --msp");
    }
    one_drone(line, verb_options, "path",
              "Fly along a CSV file, x,y[,z[,speed]] a line in the map, in a manual flight");
    all.back().option("FILE", verb_options.path_file, "of waypoints").required().existing_file();
    all.back().flag("--land", verb_options.land, "at its end; else hover");
    all.push_back(line.verb("login", "Sign in as an operator"));
    all.back().option("--operator", verb_options.name, "who").required();
    all.back().option("--pass-phrase-file", verb_options.pass_phrase_file,
                      "file that nobody else may read; else it is asked for");
    all.push_back(line.verb("logout", "Sign out: what this operator holds is landed and given back"));
    line.renamed("lift", "clear_stop");
    line.verbs_are_optional();
  }
  std::string chosen() const {
    for (const Verb& verb : all) {
      if (verb.is_given()) return verb.name();
    }
    return "";
  }
  /// Takes names, or --all.
  bool is_for_many(const std::string& verb) const { return std::ranges::find(many, verb) != many.end(); }

 private:
  Option with_names(CommandLine& line, VerbOptions& verb_options, const char* name, const char* help) {
    all.push_back(line.verb(name, help));
    return all.back().option("NAME", verb_options.names, "of drones");
  }
  void for_many(CommandLine& line, VerbOptions& verb_options, const char* name, const char* help, const char* whom) {
    with_names(line, verb_options, name, help);
    all.back().flag("--all", verb_options.all, whom);
    many.emplace_back(name);
  }
  void with_wait(VerbOptions& verb_options) { all.back().flag("--wait", verb_options.wait, wait_help); }
  void with_priority(VerbOptions& verb_options) {
    all.back().option("--priority", verb_options.priority, "of the lease or the request");
  }
  void one_drone(CommandLine& line, VerbOptions& verb_options, const char* name, const char* help) {
    all.push_back(line.verb(name, help));
    all.back().option("NAME", verb_options.drone, "of a drone").required();
  }
  std::vector<Verb> all;
  std::vector<std::string> many;
};

}  // namespace

int ledgerline::command::drones(int argc, char** argv) {
  CommandLine line("ledgerline drones", about, notes);
  VerbOptions verb_options;
  add_options(line, verb_options.options);
  line.flag("--watch", verb_options.watch, "print again at each change, until SIGINT");
  line.flag("--wait", verb_options.wait, std::string("of takeoff, land, stop and cut: ") + wait_help);
  const Verbs verbs(line, verb_options);
  if (const auto end = line.parse(argc, argv)) return *end;
  const std::string verb = verbs.chosen();
  if (!verb_options.drone.empty()) verb_options.names = {verb_options.drone};
  if (const std::string why = nonsense(verb_options, verb, verbs.is_for_many(verb)); !why.empty())
    return fail(Error{why}, exit_usage);
  verb_options.options.signs_in = verb == "login";
  return run(verb_options.options,
             [&](Station& station, const Target& target) { return act_and_wait(station, target, verb_options, verb); });
}
