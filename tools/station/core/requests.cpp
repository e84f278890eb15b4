#include "tools/station/core/requests.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "common/base/printable.hpp"
#include "ground/mission/mission.hpp"
#include "ground/motion/csv.hpp"
#include "tools/station/core/place.hpp"

namespace ledgerline::station {
namespace {

using nlohmann::json;

bool is_heading(std::span<const std::string_view> cells) { return cells.size() >= 2 && cells[0] == "x"; }

json json_of(const motion::Waypoint& point) {
  json one{{"x", point.at_m.x()}, {"y", point.at_m.y()}};
  if (point.height_m) one["z"] = *point.height_m;
  if (point.speed_mps) one["speed"] = *point.speed_mps;
  return one;
}

Request post(std::string target, std::string body) {
  return {.method = "POST", .target = std::move(target), .body = std::move(body), .anybodys = false};
}

}  // namespace

Request drone_request(const std::string& drone, const std::string& verb, std::string body) {
  Request request = post(fmt::format("drones/{}/{}", drone, verb), std::move(body));
  request.anybodys = verb == "land" || verb == "stop";
  return request;
}

Request stop_all() {
  Request request = post("stop", "{}");
  request.anybodys = true;
  return request;
}

Request cut_all(bool confirmed) { return post("stop", json{{"cut", true}, {"confirmed", confirmed}}.dump()); }

std::string to_body(const std::string& msp, const std::string& subject) {
  return json{{"to", {{"msp", msp}, {"subject", subject}}}}.dump(-1, ' ', false, json::error_handler_t::replace);
}

Result<std::string> path_body(const std::string& csv, const std::string& file, bool land) {
  json waypoints = json::array();
  bool first = true;
  for (motion::CsvLines lines(csv); lines.next();) {
    const auto cells = motion::cells_of(lines.line());
    if (std::exchange(first, false) && is_heading(cells)) continue;
    const auto point = motion::waypoint_of(cells, ground::mission::max_coordinate_m);
    if (!point) return Error{fmt::format("{}:{}: {}", file, lines.number(), point.error().message)};
    if (waypoints.size() == motion::max_waypoints)
      return Error{fmt::format("{}:{}: more than {} points", file, lines.number(), motion::max_waypoints)};
    waypoints.push_back(json_of(*point));
  }
  if (waypoints.empty()) return Error{file + ": has no point"};
  return json{{"waypoints", waypoints}, {"then", land ? "land" : "hover"}}.dump();
}

Request events_since(std::uint64_t number) { return {.target = fmt::format("events?since={}", number)}; }

Request sign_in(const std::string& name, const std::string& pass_phrase) {
  Request request = post("session", json{{"operator", name}, {"passphrase", pass_phrase}}.dump(
                                        -1, ' ', false, json::error_handler_t::replace));
  request.anybodys = true;
  return request;
}

Result<Request> mission_to_add(const std::string& file, std::string text, const std::string& name) {
  if (text.size() > ground::mission::max_mission_bytes)
    return Error{fmt::format("{}: has {} bytes; {} may be", file, text.size(), ground::mission::max_mission_bytes)};
  if (file.ends_with(".json")) {
    if (!name.empty()) return Error{file + ": JSON says the mission's name; --name is for CSV"};
    return post("missions", std::move(text));
  }
  if (!file.ends_with(".csv")) return Error{file + ": is neither .json nor .csv (docs/station.md)"};
  const auto slash = file.rfind('/');
  const std::string stem = file.substr(slash + 1, file.size() - slash - 1 - std::string_view(".csv").size());
  const std::string& named = name.empty() ? stem : name;
  if (!ground::mission::is_name(named))
    return Error{fmt::format("\"{}\" is no mission's name: 1 to 64 of A-Z, a-z, 0-9, _ and - (--name)",
                             printable(named, ground::mission::max_name))};
  Request request = post("missions?name=" + named, std::move(text));
  request.content_type = "text/csv";
  return request;
}

Request mission_request(const std::string& id, const std::string& verb) {
  Request request = post(fmt::format("missions/{}/{}", id, verb), "{}");
  request.anybodys = verb == "land";
  return request;
}

Status check_answer(const Answer& answer) {
  if (answer.status >= 200 && answer.status < 300) return done;
  const json body = json::parse(answer.body, nullptr, false);
  const json words = body.is_object() ? body.value("error", json()) : json();
  return Error{fmt::format("the station answers {}: {}", answer.status,
                           words.is_string() ? printable(words.get_ref<const std::string&>()) : "without a word")};
}

Result<Session> session_from(const std::string& body) {
  const json read = json::parse(body, nullptr, false);
  const auto text = [&](const char* key) {
    const json value = read.is_object() ? read.value(key, json()) : json();
    return value.is_string() ? value.get<std::string>() : std::string();
  };
  Session session{text("session"), printable(text("operator")), printable(text("identity"))};
  if (!is_token(session.token)) return Error{"the station's answer has no session in it"};
  return session;
}

Result<std::string> signed_in_as(const std::string& body) {
  const json read = json::parse(body, nullptr, false);
  if (!read.is_object() || !read.contains("you")) return Error{"the station's answer does not say who is signed in"};
  return read["you"].is_string() ? read["you"].get<std::string>() : std::string();
}

}  // namespace ledgerline::station
