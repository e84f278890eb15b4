#include "tools/station/core/requests.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "common/base/text.hpp"
#include "ground/json/strict.hpp"
#include "ground/mission/mission.hpp"
#include "ground/motion/waypoints.hpp"
#include "ground/service/missions/approvals.hpp"

namespace ledgerline::station {

namespace {

using nlohmann::json;

json json_of(const ground::motion::Waypoint& point) {
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
  const auto path = ground::motion::path_from_csv(csv, file);
  if (!path) return path.error();
  json waypoints = json::array();
  for (const ground::motion::Waypoint& point : *path) waypoints.push_back(json_of(point));
  return json{{"waypoints", waypoints}, {"then", land ? "land" : "hover"}}.dump();
}

Request events_since(std::uint64_t number) { return {.target = fmt::format("events?since={}", number)}; }

Request sign_in(const std::string& name, const std::string& pass_phrase) {
  Request request = post("session", json{{"operator", name}, {"passphrase", pass_phrase}}.dump(
                                        -1, ' ', false, json::error_handler_t::replace));
  request.anybodys = true;
  return request;
}

namespace {

/// Of a mission in CSV, which has none in it: `name`, else the file's.
Result<std::string> csv_name(const std::string& file, const std::string& name) {
  const auto slash = file.rfind('/');
  const std::string stem = file.substr(slash + 1, file.size() - slash - 1 - std::string_view(".csv").size());
  const std::string& named = name.empty() ? stem : name;
  if (ground::mission::is_name(named)) return named;
  return Error{fmt::format("\"{}\" is no mission's name: 1 to 64 of A-Z, a-z, 0-9, _ and - (--name)",
                           printable(named, ground::mission::max_name))};
}

// What a station keeps of a mission, whole: it is a little more than the mission, and two objects deeper.
constexpr ground::json::Bounds kept_bounds{
    ground::mission::max_mission_bytes + 131'072, 8,
    (5 * ground::motion::max_waypoints + 40) * ground::mission::max_drones + 1'000};

/// The mission within what a station keeps of one: its state, {"by","run":{"mission"}}, or its record, {"mission"}.
/// Nothing: the text is neither.
std::optional<json> kept_mission(const std::string& text) {
  const auto kept = ground::json::object_from(text, "the kept mission", kept_bounds);
  if (!kept) return std::nullopt;
  const auto run = kept->find("run");
  const json& around = run != kept->end() && run->is_object() ? *run : *kept;
  const auto mission = around.find("mission");
  return mission == around.end() ? std::nullopt : std::optional<json>(*mission);
}

Status check_file(const std::string& file, const std::string& text, const std::string& name) {
  if (text.size() > ground::mission::max_mission_bytes)
    return Error{fmt::format("{} has {} bytes; {} may be", file, text.size(), ground::mission::max_mission_bytes)};
  if (file.ends_with(".json") && !name.empty())
    return Error{file + ": JSON says the mission's name; --name is for CSV"};
  if (!file.ends_with(".json") && !file.ends_with(".csv"))
    return Error{file + " is neither .json nor .csv (docs/station.md)"};
  return done;
}

}  // namespace

Result<ground::mission::Mission> mission_from(const std::string& file, const std::string& text,
                                              const std::string& name) {
  const auto kept = file.ends_with(".json") && name.empty() ? kept_mission(text) : std::nullopt;
  if (const Status checked = kept ? Status(done) : check_file(file, text, name); !checked) return checked.error();
  if (file.ends_with(".json")) {
    auto mission = kept ? ground::mission::mission_from_document(*kept) : ground::mission::mission_from_json(text);
    if (!mission) return Error{file + ": " + mission.error().message};
    return mission;
  }
  const auto named = csv_name(file, name);
  if (!named) return named.error();
  return ground::mission::mission_from_csv(text, *named, file);
}

Result<MissionDigests> digests_of(const ground::mission::Mission& mission, const std::string& ground,
                                  std::int64_t until_s, std::int64_t lasts_s) {
  const crypto::Digest digest = ground::mission::digest(mission);
  MissionDigests digests{mission.name, crypto::hex(digest), {}, {}, {}};
  if (ground.empty()) return digests;
  const auto blank = ground.find(' ');
  if (blank == std::string::npos) return Error{"--ground is as the approval's words end: 'Org2MSP CN=...'"};
  const ground::service::ApprovalTerms terms({ground.substr(0, blank), ground.substr(blank + 1)}, lasts_s);
  const std::int64_t half_s = lasts_s / 2, given_s = until_s - 2 * half_s;  // where the approval's period begins
  if (given_s < 0 || until_s % half_s != 0)
    return Error{
        "no approval ends at --until: give it as the approval's words do, and --hours as that ground has them"};
  const auto on_ledger = terms.now(digest, given_s).front();
  digests.words = terms.approval_words(mission.name, given_s);
  digests.approval = crypto::hex(on_ledger.approval);
  digests.withdrawal = crypto::hex(on_ledger.withdrawal);
  return digests;
}

Result<Request> mission_to_add(const std::string& file, std::string text, const std::string& name) {
  if (file.ends_with(".json")) {  // the station reads it
    if (const Status checked = check_file(file, text, name); !checked) return checked.error();
    return post("missions", std::move(text));
  }
  const auto mission = mission_from(file, text, name);
  if (!mission) return mission.error();
  Request request = post("missions?name=" + mission->name, std::move(text));
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

bool nobody_signs_in(const std::string& body) {
  const json read = json::parse(body, nullptr, false);
  return read.is_object() && read.contains("operators") && read["operators"].is_array() && read["operators"].empty();
}

Result<std::string> signed_in_as(const std::string& body) {
  const json read = json::parse(body, nullptr, false);
  if (!read.is_object() || !read.contains("you")) return Error{"the station's answer does not say who is signed in"};
  return read["you"].is_string() ? read["you"].get<std::string>() : std::string();
}

Result<std::string> identity_signed_in(const std::string& body) {
  const auto name = signed_in_as(body);
  if (!name || name->empty()) return name;
  const json read = json::parse(body, nullptr, false);
  for (const json& one : read.value("operators", json::array())) {
    if (one.is_object() && one.value("name", json()) == *name && one.value("identity", json()).is_string())
      return one["identity"].get<std::string>();
  }
  return Error{"the station's answer does not say who " + *name + " is"};
}

namespace {

constexpr std::size_t token_digits = 64;

/// Without TLS the token goes there as it is.
Result<StationAddress> address_from(const std::string& text, bool tls) {
  auto at = web::host_port_from(text);
  if (!at) return at.error();
  if (!tls && at->host == "localhost") at->host = "127.0.0.1";
  if (!tls && !web::is_loopback(at->host))
    return Error{
        "must be this computer (127.0.0.1 or localhost) without TLS: https:// where the station has it, else an SSH "
        "tunnel"};
  return StationAddress{*at, tls};
}

}  // namespace

std::string text_of(const StationAddress& address) { return web::text_of(address.at); }

Result<StationAddress> address_from_url(const std::string& url) {
  constexpr std::string_view plain = "http://", secure = "https://";
  const auto wrong = [&](const std::string& what) {
    // What stands behind # in a page's address is its token.
    return Error{fmt::format("the station's address \"{}\" {}", printable(url.substr(0, url.find('#')), 128), what)};
  };
  const bool tls = url.starts_with(secure);
  if (!tls && !url.starts_with(plain)) return wrong("must begin with http:// or https://");
  std::string host_port = url.substr(tls ? secure.size() : plain.size());
  if (host_port.ends_with('/')) host_port.pop_back();
  if (host_port.find_first_of("/#?@") != std::string::npos)
    return wrong("must end behind its port; the token is in a file of its own");
  auto parsed = address_from(host_port, tls);
  if (!parsed) return wrong(parsed.error().message);
  if (parsed->at.port == 0) return wrong("must end in a port from 1 to 65535");
  return parsed;
}

Result<StationAddress> address_from_service(const ground::service::ServiceSettings& service) {
  auto parsed = address_from(service.listen, service.has_tls());
  if (!parsed) return parsed;
  if (parsed->at.port == 0)
    return Error{"has port 0, any that is free: which one it was ground says when it is ready; give it with --url"};
  if (!service.names.empty()) parsed->at.host = service.names.front();
  return parsed;
}

bool is_token(const std::string& text) {
  return text.size() == token_digits && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

}  // namespace ledgerline::station
