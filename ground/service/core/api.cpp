#include "ground/service/core/api.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <charconv>
#include <nlohmann/json.hpp>

#include "common/base/enum_count.hpp"
#include "common/base/text.hpp"
#include "common/msg/contract.hpp"
#include "ground/core/flight/phases.hpp"
#include "ground/json/strict.hpp"

namespace ledgerline::ground::service {
namespace {

namespace strict = ground::json;
using nlohmann::json;
using strict::dump;
using strict::max_shown;
using strict::only;

constexpr std::string_view root = "/api/v1/";
constexpr std::size_t max_pass_phrase = 256;
// Of any request but a new mission: a path is the largest, five values a waypoint.
constexpr strict::Bounds bounds{max_body_bytes, 4, 5 * motion::max_waypoints + 100};

constexpr const char* word_of(Level level) {
  constexpr std::array words{"info", "warning", "alarm"};
  static_assert(words.size() == enum_count<Level>);
  return words[static_cast<std::size_t>(level)];
}

json event_json(const Event& event) {
  return {{"n", event.number},
          {"t_ms", to_ms(event.at_ns)},
          {"level", word_of(event.level)},
          {"drone", event.drone},
          {"text", event.text}};
}

json events_json(const std::deque<Event>& events, std::size_t first) {
  json list = json::array();
  for (std::size_t i = first; i < events.size(); ++i) list.push_back(event_json(events[i]));
  return list;
}

Result<json> object_from(std::string_view body, const strict::Bounds& within = bounds) {
  return strict::object_from(body, "the body", within);
}
Result<json> object_from(std::string_view body, std::initializer_list<std::string_view> allowed,
                         const strict::Bounds& within = bounds) {
  auto object = object_from(body, within);
  if (!object) return object;
  if (const Status keys = only(*object, allowed); !keys) return keys.error();
  return object;
}

/// Who asks, for people. An event that begins with an operator's name is what came of it (update_of()).
std::string asker_text(const ApiRequest& request, const ApiContext& known) {
  if (request.who) return known.operators[*request.who].name;
  return request.session_ended ? "a session that is over" : "the page's token";
}

/// What is commanded, for people; the safest of it, as it is what counts.
const char* words_of(const PilotCommand& command) {
  if (command.cut) return "cut";
  if (command.stop) return "stop";
  if (command.land) return "land";
  if (command.takeoff) return "take off";
  if (command.pause) return "pause";
  if (command.clear_stop) return "clear the stop";
  if (!command.order) return "fly";
  switch (command.order->kind) {
    case PilotOrder::Kind::path:
      return "fly a path";
    case PilotOrder::Kind::resume:
      return "resume the path";
    case PilotOrder::Kind::return_home:
      return "return";
  }
  return "fly";
}

bool has(std::span<const std::size_t> drones, std::size_t drone) {
  return std::ranges::find(drones, drone) != drones.end();
}

constexpr const char* taken = R"({"accepted":true})";
ApiAnswer accepted(std::vector<PilotCommand> commands, bool confirmed = false) {
  return {.status = 202, .body = taken, .commands = std::move(commands), .confirmed = confirmed};
}

Result<PilotOrder> path_from(const json& body) {
  if (const Status keys = only(body, {"waypoints", "then"}); !keys) return keys.error();
  const json waypoints = body.value("waypoints", json());
  const json then = body.value("then", json("hover"));
  if (!waypoints.is_array() || waypoints.empty() || waypoints.size() > motion::max_waypoints)
    return Error{fmt::format("waypoints must be a list of 1 to {}", motion::max_waypoints)};
  const auto land_behind = strict::land_behind_from(then);
  if (!land_behind) return land_behind.error();
  PilotOrder order{.kind = PilotOrder::Kind::path, .land_behind = *land_behind};
  for (const json& given : waypoints) {
    auto waypoint = strict::waypoint_from(given);
    if (!waypoint) return Error{fmt::format("waypoint {}: {}", order.waypoints.size() + 1, waypoint.error().message)};
    order.waypoints.push_back(*waypoint);
  }
  return order;
}

/// False where it is not there.
Result<bool> flag_in(const json& body, const char* key) {
  const json flag = body.value(key, json(false));
  if (!flag.is_boolean()) return Error{std::string(key) + " must be true or false"};
  return flag.get<bool>();
}

/// {"to":{"msp":"Org2MSP","subject":"CN=..."}}
Result<crypto::IdentityName> identity_from(const json& body) {
  if (const Status keys = only(body, {"to"}); !keys) return keys.error();
  const json to = body.value("to", json());
  if (!to.is_object()) return Error{"to must be an object"};
  if (const Status keys = only(to, {"msp", "subject"}); !keys) return keys.error();
  const json msp = to.value("msp", json()), subject = to.value("subject", json());
  if (!msp.is_string() || !subject.is_string()) return Error{"to needs msp and subject"};
  return crypto::IdentityName{msp.get<std::string>(), subject.get<std::string>()};
}

/// Of a verb in a table of verbs.
template <typename Verbs>
auto kind_in(const Verbs& verbs, std::string_view verb) {
  const auto row = std::ranges::find_if(verbs, [&](const auto& one) { return one.first == verb; });
  return row == verbs.end() ? std::nullopt : std::optional(row->second);
}

std::optional<OperatorCall::Kind> call_of(std::string_view verb) {
  using Kind = OperatorCall::Kind;
  constexpr std::array<std::pair<std::string_view, Kind>, enum_count<Kind> - 2> verbs{
      {{"acquire", Kind::acquire},
       {"release", Kind::release},
       {"request", Kind::request},
       {"hand_over", Kind::hand_over},
       {"deny", Kind::deny},
       {"clear_stop", Kind::clear_stop}}};
  return kind_in(verbs, verb);
}

/// What an operator signs for a drone.
ApiAnswer answer_call(const ApiRequest& request, OperatorCall call, const ApiContext& known) {
  using Kind = OperatorCall::Kind;
  if (request.method != "POST") return refusal(405, "POST it");
  if (known.operators.empty() && call.kind == Kind::clear_stop) {
    const auto body = object_from(request.body, {});
    if (!body) return refusal(400, body.error().message);
    if (!has(known.stopped, *call.drone)) return refusal(409, known.names[*call.drone] + " is not stopped");
    if (!has(known.stopped_by_ground, *call.drone))
      return refusal(409, known.names[*call.drone] + " is stopped by others: they clear it, by `ledgerline control`");
    if (has(known.aloft, *call.drone))
      return refusal(409, known.names[*call.drone] + " is in the air, or not heard: its stop is cleared on the ground");
    return accepted({PilotCommand{.drone = *call.drone, .clear_stop = true}});
  }
  if (known.operators.empty())
    return refusal(404, "nobody signs in here: [service] operators is not set; ledgerline control does that");
  if (!request.who) return refusal(403, "sign in first: commands are signed by the operator");
  const auto body = object_from(request.body);
  if (!body) return refusal(400, body.error().message);
  if (call.kind == Kind::hand_over || call.kind == Kind::deny) {
    auto to = identity_from(*body);
    if (!to) return refusal(400, to.error().message);
    call.to = std::move(*to);
  } else if (call.kind == Kind::acquire || call.kind == Kind::request) {
    if (const Status keys = only(*body, {"priority"}); !keys) return refusal(400, keys.error().message);
    const json priority = body->value("priority", json(0U));
    if (!priority.is_number_unsigned() || priority.get<std::uint64_t>() > contract::max_priority)
      return refusal(400, fmt::format("priority must be a number up to {}", contract::max_priority));
    call.priority = priority.get<std::uint32_t>();
  } else if (call.kind == Kind::release) {
    if (const Status keys = only(*body, {"confirmed"}); !keys) return refusal(400, keys.error().message);
    const auto confirmed = flag_in(*body, "confirmed");
    if (!confirmed) return refusal(400, confirmed.error().message);
    if (has(known.aloft, *call.drone) && !*confirmed)
      return refusal(409, fmt::format("{} is in the air: nobody commands it then, and it lands by its failsafe; say "
                                      "\"confirmed\":true if that is meant",
                                      known.names[*call.drone]));
  } else if (const Status keys = only(*body, {}); !keys) {
    return refusal(400, keys.error().message);
  }
  call.ground_too = call.kind == Kind::clear_stop && has(known.stopped_by_ground, *call.drone);
  return {.status = 202, .body = taken, .call = std::move(call)};
}

/// Reads who signs in; whether the pass phrase is right is found in ground/service/shell/sessions.cpp.
ApiAnswer answer_session(const ApiRequest& request, const ApiContext& known) {
  if (request.method == "DELETE") {
    if (!request.who) return refusal(403, "nobody is signed in with this token");
    return {.status = 202, .body = taken, .sign_out = true};
  }
  if (request.method != "POST") return refusal(405, "POST it, or DELETE it");
  auto body = object_from(request.body, {"operator", "passphrase"});
  if (!body) return refusal(400, body.error().message);
  const json name = body->value("operator", json());
  const auto phrase = body->find("passphrase");
  if (!name.is_string() || phrase == body->end() || !phrase->is_string())
    return refusal(400, "needs operator and passphrase");
  auto pass_phrase = std::make_shared<const crypto::WipingString>(std::move(phrase->get_ref<std::string&>()));
  if (pass_phrase->size() > max_pass_phrase)
    return refusal(400, fmt::format("a passphrase has {} bytes at most", max_pass_phrase));
  const auto who = std::ranges::find_if(
      known.operators, [&](const Operator& one) { return one.name == name.get_ref<const std::string&>(); });
  if (who == known.operators.end()) return refusal(404, "no operator of that name signs in here");
  return {.status = 200,
          .body = {},
          .sign_in = SignIn{static_cast<std::size_t>(who - known.operators.begin()), std::move(pass_phrase)}};
}

ApiAnswer answer_operators(const ApiRequest& request, const ApiContext& known) {
  if (request.method != "GET") return refusal(405, "GET it");
  json all = json::array();
  for (const Operator& one : known.operators) all.push_back({{"name", one.name}, {"identity", text_of(one.identity)}});
  return {200, dump({{"operators", all}, {"you", request.who ? json(known.operators[*request.who].name) : json()}})};
}

constexpr std::string_view missions_path = "missions";

std::optional<MissionRequest::Kind> mission_verb(std::string_view verb) {
  using Kind = MissionRequest::Kind;
  constexpr std::array<std::pair<std::string_view, Kind>, 6> verbs{{{"approve", Kind::approve},
                                                                    {"withdraw", Kind::withdraw},
                                                                    {"start", Kind::start},
                                                                    {"pause", Kind::pause},
                                                                    {"resume", Kind::resume},
                                                                    {"land", Kind::land}}};
  return kind_in(verbs, verb);
}

ApiAnswer mission_answer(const ApiRequest& request, MissionRequest asked, const ApiContext& known) {
  asked.who = request.who;
  asked.asker = asker_text(request, known);
  if (request.who) asked.by = known.operators[*request.who].identity;
  const bool looks = asked.kind == MissionRequest::Kind::list || asked.kind == MissionRequest::Kind::show;
  if (!looks && asked.kind != MissionRequest::Kind::land && !known.operators.empty() && !request.who)
    return refusal(403, "sign in first: commands are signed by the operator; to have all land needs no operator");
  return {.status = 202, .body = {}, .mission = std::move(asked)};
}

/// `path`: behind "missions".
ApiAnswer answer_missions(const ApiRequest& request, std::string_view path, std::string_view query,
                          const ApiContext& known) {
  using Kind = MissionRequest::Kind;
  MissionRequest asked;
  if (path.empty()) {
    if (request.method == "GET") return mission_answer(request, std::move(asked), known);
    if (request.method != "POST") return refusal(405, "GET it, or POST a mission");
    asked.kind = Kind::add;
    asked.csv = request.content_type.substr(0, 8) == "text/csv";
    constexpr std::string_view key = "name=";
    if (!query.empty() && (!asked.csv || query.substr(0, key.size()) != key))
      return refusal(400, "missions takes name=NAME with text/csv; JSON has its name within");
    if (!query.empty()) asked.name = query.substr(key.size());
    asked.text = request.body;
    return mission_answer(request, std::move(asked), known);
  }
  const std::string_view rest = path.substr(1);
  const auto slash = rest.find('/');
  asked.id = rest.substr(0, std::min<std::size_t>(slash, max_shown));
  if (slash == std::string_view::npos) {
    if (request.method != "GET" && request.method != "DELETE") return refusal(405, "GET it, or DELETE it");
    asked.kind = request.method == "GET" ? Kind::show : Kind::remove;
    return mission_answer(request, std::move(asked), known);
  }
  const auto verb = mission_verb(rest.substr(slash + 1));
  if (!verb) return refusal(404, "a mission knows approve, withdraw, start, pause, resume, land");
  if (request.method != "POST") return refusal(405, "POST it");
  if (const auto body = object_from(request.body, {}); !body) return refusal(400, body.error().message);
  asked.kind = *verb;
  return mission_answer(request, std::move(asked), known);
}

ApiAnswer answer_drone(const ApiRequest& request, std::string_view path, const ApiContext& known) {
  const auto slash = path.find('/');
  const std::string_view name = path.substr(0, slash);
  const std::string_view verb = slash == std::string_view::npos ? "" : path.substr(slash + 1);
  const auto drone = drone_of(known.names, name);
  if (!drone) return refusal(404, "no drone \"" + printable(std::string(name), max_shown) + "\" flies here");
  if (const auto call = call_of(verb)) return answer_call(request, {.kind = *call, .drone = *drone}, known);
  PilotCommand command{.drone = *drone};
  if (verb == "takeoff") {
    command.takeoff = true;
  } else if (verb == "land") {
    command.land = true;
  } else if (verb == "stop") {
    command.stop = true;
  } else if (verb == "cut") {
    command.stop = command.cut = true;
  } else if (verb == "pause") {
    command.pause = true;
  } else if (verb == "resume") {
    command.order = PilotOrder{.kind = PilotOrder::Kind::resume};
  } else if (verb == "return") {
    command.order = PilotOrder{.kind = PilotOrder::Kind::return_home};
  } else if (verb != "path") {
    return refusal(404,
                   "a drone knows takeoff, land, stop, cut, path, pause, resume, return, acquire, release, request, "
                   "hand_over, deny, clear_stop");
  }
  if (request.method != "POST") return refusal(405, "POST it");
  const auto body = object_from(request.body);
  if (!body) return refusal(400, body.error().message);
  if (verb == "path") {
    auto order = path_from(*body);
    if (!order) return refusal(400, order.error().message);
    command.order = std::move(*order);
  } else if (verb == "cut") {
    if (const Status keys = only(*body, {"confirmed"}); !keys) return refusal(400, keys.error().message);
    const auto confirmed = flag_in(*body, "confirmed");
    if (!confirmed) return refusal(400, confirmed.error().message);
    return accepted({std::move(command)}, *confirmed);
  } else if (const Status keys = only(*body, {}); !keys) {
    return refusal(400, keys.error().message);
  }
  return accepted({std::move(command)});
}

ApiAnswer answer_stop(const ApiRequest& request, const ApiContext& known) {
  if (request.method != "POST") return refusal(405, "POST it");
  const auto body = object_from(request.body, {"cut", "confirmed"});
  if (!body) return refusal(400, body.error().message);
  const auto cut = flag_in(*body, "cut"), confirmed = flag_in(*body, "confirmed");
  if (!cut || !confirmed) return refusal(400, (cut ? confirmed : cut).error().message);
  std::vector<PilotCommand> commands;
  for (std::size_t drone = 0; drone < known.names.size(); ++drone)
    commands.push_back({.drone = drone, .stop = true, .cut = *cut});
  return accepted(std::move(commands), *confirmed);
}

ApiAnswer answer_events(std::string_view query, const ApiContext& known) {
  std::uint64_t since = 0;
  if (!query.empty()) {
    constexpr std::string_view key = "since=";
    const std::string_view digits = query.substr(0, key.size()) == key ? query.substr(key.size()) : "";
    const auto read = std::from_chars(digits.data(), digits.data() + digits.size(), since);
    if (digits.empty() || read.ec != std::errc() || read.ptr != digits.data() + digits.size())
      return refusal(400, "events takes since=NUMBER");
  }
  const auto first = std::ranges::find_if(known.events, [&](const Event& event) { return event.number > since; });
  const auto at = static_cast<std::size_t>(first - known.events.begin());
  return {200, dump({{"t_ms", to_ms(known.now_ns)}, {"events", events_json(known.events, at)}})};
}

ApiAnswer answer_faults(const ApiRequest& request, const ApiContext& known) {
  if (request.method != "GET" && request.method != "POST") return refusal(405, "GET it, or POST one that is switched");
  if (!known.faults) return refusal(404, "there are no faults to switch here: [service] faults is not set");
  if (!known.faults->why.empty()) return refusal(503, known.faults->why);
  if (request.method == "GET") return {200, faults_text(*known.faults)};
  const auto body = object_from(request.body, {"name", "on"}, {max_body_bytes, 2, 8});
  if (!body) return refusal(400, body.error().message);
  const json name = body->value("name", json()), on = body->value("on", json());
  if (!name.is_string() || !on.is_boolean()) return refusal(400, "needs name, and on: true or false");
  FaultRequest asked{.name = name.get<std::string>(), .on = on.get<bool>()};
  const auto& all = known.faults->switches;
  if (std::ranges::none_of(all, [&](const FaultSwitch& one) { return one.name == asked.name; }))
    return refusal(404, "there is no fault \"" + printable(asked.name, max_shown) + "\"");
  // To end one is never wrong, and nobody has to look for a pass phrase.
  if (asked.on && !known.operators.empty() && !request.who)
    return refusal(403, "sign in first: commands are signed by the operator; to switch one off needs no operator");
  if (request.who) asked.by = known.operators[*request.who].name;
  return {.status = 200, .body = {}, .fault = std::move(asked)};
}

ApiAnswer answer_any(const ApiRequest& request, const ApiContext& known) {
  const std::string_view target = request.target;
  if (target.substr(0, root.size()) != root) return refusal(404, "the API is below /api/v1/");
  const auto question = target.find('?');
  const std::string_view path = target.substr(root.size(), question - root.size());
  const std::string_view query = question == std::string_view::npos ? "" : target.substr(question + 1);
  constexpr std::string_view of_drone = "drones/";
  if (path == "drones" || path == "events" || path == "paths") {
    if (request.method != "GET") return refusal(405, "GET it");
    if (path == "events") return answer_events(query, known);
    if (path == "paths") return {200, fmt::format(R"({{"paths":{}}})", known.paths)};
    return {200, fmt::format(R"({{"drones":{}}})", known.drones)};
  }
  if (path.substr(0, missions_path.size()) == missions_path) {
    const std::string_view behind = path.substr(missions_path.size());
    if (behind.empty() || behind[0] == '/') return answer_missions(request, behind, query, known);
  }
  if (path == "operators") return answer_operators(request, known);
  if (path == "faults") return answer_faults(request, known);
  if (path == "session") return answer_session(request, known);
  if (path == "stop") return answer_stop(request, known);
  if (path.substr(0, of_drone.size()) == of_drone) return answer_drone(request, path.substr(of_drone.size()), known);
  return refusal(404, "there are drones, events, faults, missions, operators, paths, session, stop, stream");
}

bool lands_and_nothing_else(const ApiAnswer& made) {
  if (made.mission) return made.mission->kind == MissionRequest::Kind::land;
  return !made.commands.empty() && std::ranges::all_of(made.commands, only_lands);
}

/// Of a drone that is to be cut in the air where nobody has confirmed it.
std::optional<std::size_t> unconfirmed_cut(const ApiAnswer& made, std::span<const std::size_t> aloft) {
  const auto cut = std::ranges::find_if(
      made.commands, [&](const PilotCommand& command) { return command.cut && has(aloft, command.drone); });
  return made.confirmed || cut == made.commands.end() ? std::nullopt : std::optional(cut->drone);
}

/// Why this person's order is not taken; empty: its drone's lease allows it, or no lease is needed.
std::string lease_problem(const ApiRequest& request, const PilotCommand& command, const ApiContext& known) {
  if (brings_down(command) || command.clear_stop || command.drone >= known.leases.size()) return "";
  const LeaseState& lease = known.leases[command.drone];
  const bool is_holder = !request.who || !lease.holder || known.operators[*request.who].identity == *lease.holder;
  if (lease.ours && is_holder) return "";
  const std::string& name = known.names[command.drone];
  const bool asks = lease.holder && (!is_holder || !request.who);  // else it is free, or one's own, commanded elsewhere
  return fmt::format("{}: {}: `ledgerline {} {} {}` {} it first", name, lease.words,
                     known.operators.empty() ? "control --config operator.toml" : "drones",
                     asks ? "request" : "acquire", name, asks ? "asks for" : "takes");
}

/// Why its drone cannot do that now; empty: it can, or the flight decides.
std::string phase_problem(const PilotCommand& command, const ApiContext& known) {
  const bool needs_flight = command.order || command.pause;
  if (brings_down(command) || !(command.takeoff || needs_flight) || command.drone >= known.phases.size()) return "";
  const std::string& name = known.names[command.drone];
  const GroundPhase phase = known.phases[command.drone];
  if (!known.manual) return name + " flies its flight's path: only a flight with shape = \"manual\" takes others";
  if (phase == GroundPhase::landing) return name + " is landing: wait until it is on the ground";
  if (command.takeoff && is_in_air(phase)) return name + " is in the air already: land it first";
  if (phase == GroundPhase::takeoff) return name + " is taking off: wait until it hovers";
  if (command.order && has(known.unplaced, command.drone)) return name + " has no pose, and a path needs one";
  if (is_in_air(phase)) return "";
  if (has(known.stopped, command.drone)) return name + " is stopped: clear the stop first";
  if (command.takeoff || has(known.aloft, command.drone)) return "";
  return name + " is on the ground: let it take off first";
}

/// The first waypoint beyond the fence; empty: none is.
std::string path_problem(const PilotCommand& command, const ApiContext& known) {
  if (!known.fence || !command.order) return "";
  for (std::size_t i = 0; i < command.order->waypoints.size(); ++i) {
    const Waypoint& waypoint = command.order->waypoints[i];
    const std::string problem = mission::fence_problem(
        *known.fence, {waypoint.at_m.x(), waypoint.at_m.y(), waypoint.height_m.value_or(known.height_m)});
    if (!problem.empty()) return fmt::format("waypoint {}: {}", i + 1, problem);
  }
  return "";
}

}  // namespace

std::string text_of(const crypto::IdentityName& who) { return who.msp_id + " " + who.subject; }

ApiAnswer refusal(unsigned status, const std::string& words) { return {status, dump({{"error", words}})}; }

ApiAnswer answer(const ApiRequest& request, const ApiContext& known) {
  ApiAnswer made = answer_any(request, known);
  if (request.session_ended && !lands_and_nothing_else(made)) return refusal(401, session_over);
  if (made.commands.empty()) return made;
  // Nobody has to look for a pass phrase to stop a drone.
  if (!known.operators.empty() && !request.who && !lands_and_nothing_else(made))
    return refusal(403,
                   "sign in first: commands are signed by the operator; a stop, which lands it, needs no operator");
  for (const PilotCommand& command : made.commands) {
    if (const std::string why = lease_problem(request, command, known); !why.empty()) return refusal(409, why);
    if (const std::string why = phase_problem(command, known); !why.empty()) return refusal(409, why);
    if (const std::string why = path_problem(command, known); !why.empty()) return refusal(409, why);
  }
  if (const auto drone = unconfirmed_cut(made, known.aloft))
    return refusal(409, fmt::format("{} is in the air, or not known to be on the ground: a cut drops it. If "
                                    "that is meant: \"confirmed\":true, `ledgerline drones cut --yes`; a stop lands it",
                                    known.names[*drone]));
  for (PilotCommand& command : made.commands) {
    command.requests = {fmt::format("{}, asked for by {}", words_of(command), asker_text(request, known))};
    if (request.who) command.by = known.operators[*request.who].identity;
  }
  return made;
}

std::optional<std::size_t> drone_of(const std::vector<std::string>& names, std::string_view name) {
  const auto at = std::ranges::find(names, name);
  return at == names.end() ? std::nullopt : std::optional(static_cast<std::size_t>(at - names.begin()));
}

void merge(const PilotCommand& command, PilotCommand& waiting) {
  waiting.takeoff = waiting.takeoff || command.takeoff;
  waiting.land = waiting.land || command.land;
  waiting.stop = waiting.stop || command.stop;
  waiting.cut = waiting.cut || command.cut;
  waiting.pause = waiting.pause || command.pause;
  waiting.clear_stop = waiting.clear_stop || command.clear_stop;
  waiting.late += command.late;
  if (command.order) waiting.order = command.order;
  if (command.velocity) set_velocity(*command.velocity, command.came_ns, waiting);
  for (const std::string& request : command.requests) {
    if (std::ranges::find(waiting.requests, request) == waiting.requests.end()) waiting.requests.push_back(request);
  }
}

std::string session_text(const std::string& token, const Operator& who) {
  return dump({{"session", token}, {"operator", who.name}, {"identity", text_of(who.identity)}});
}

std::size_t body_limit(std::string_view target) {
  const std::string_view path = target.substr(0, std::min(target.find('?'), target.size()));
  return path == std::string(root) + std::string(missions_path) ? max_mission_body_bytes : max_body_bytes;
}

std::string missions_message(std::string_view list) {
  return fmt::format(R"({{"op":"missions","missions":{}}})", list);
}

std::string paths_message(std::string_view paths) { return fmt::format(R"({{"op":"paths","paths":{}}})", paths); }

std::string events_message(const std::deque<Event>& events, std::size_t first) {
  return dump({{"op", "events"}, {"events", events_json(events, first)}});
}

}  // namespace ledgerline::ground::service
