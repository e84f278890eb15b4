#include "tools/station/core/show.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "common/base/text.hpp"

namespace ledgerline::station {
namespace {

using nlohmann::json;

std::string text_of(const json& value) { return printable(value.get_ref<const std::string&>()); }
std::string text_at(const json& object, const char* key) { return text_of(object.at(key)); }

/// `read` may throw nlohmann's exceptions: the answer is then no `what`.
template <typename T, typename Read>
Result<T> read_answer(std::string_view body, std::string_view what, const Read& read) {
  try {
    return Result<T>(read(json::parse(body)));
  } catch (const json::exception& wrong) {
    return Error{
        fmt::format("the station's answer is not {} as version 1 of its API has them ({})", what, wrong.what())};
  }
}

constexpr std::size_t age_column = 4;
constexpr std::string_view anchored_already = " has anchored this digest already";  // the contract's anchor says so

/// Characters, not bytes.
std::size_t width(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

std::string mode_of(const json& drone) {
  const std::string mode = text_at(drone, "mode"), words = text_at(drone, "cause_words");
  const std::string shown = mode == "none" ? "-" : mode;
  return words.empty() ? shown : fmt::format("{} ({}: {})", shown, text_at(drone, "cause"), words);
}

std::string position_of(const json& drone) {
  const json& position = drone.at("position");
  if (position.is_null()) return "-";
  const auto shown = [&](std::size_t axis) {
    const double tenths = std::round(10 * position.at(axis).get<double>());
    return tenths == 0 ? 0.0 : tenths / 10;  // no -0.0
  };
  return fmt::format("{:.1f} {:.1f} {:.1f}", shown(0), shown(1), shown(2));
}

std::string number_or_none(const json& value, std::string_view unit, int digits) {
  // Not -0, which a clock that is read twice gives.
  return value.is_null() ? "-" : fmt::format("{:.{}f}{}", std::max(0.0, value.get<double>()), digits, unit);
}

/// Ground's phase, and link's unless that says the same.
std::string phases_of(const json& drone) {
  const std::string phase = text_at(drone, "phase"), shown = phase + (drone.at("paused").get<bool>() ? ", paused" : "");
  if (!drone.at("has_state").get<bool>()) return shown + " (not heard)";
  const std::string of_link = text_at(drone, "link_phase");
  const bool is_same = of_link == phase || (phase == "waiting" && of_link == "on_ground") ||
                       (phase == "takeoff" && of_link == "taking_off");
  return is_same ? shown : fmt::format("{} ({})", shown, of_link);
}

std::vector<std::string> drone_row(const json& drone) {
  const std::string holder = text_at(drone.at("lease"), "holder");
  std::vector<std::string> stops, requests;
  for (const json& one : drone.at("stopped_by")) stops.push_back(text_of(one));
  for (const json& one : drone.at("requests")) requests.push_back(text_at(one, "msp") + " " + text_at(one, "subject"));
  return {text_at(drone, "name"),
          phases_of(drone),
          mode_of(drone),
          number_or_none(drone.at("battery_percent"), " %", 0),
          number_or_none(drone.at("state_age_ms"), " ms", 0),
          position_of(drone),
          holder.empty() ? "-" : holder,
          requests.empty() ? "-" : fmt::format("{}", fmt::join(requests, ", ")),
          stops.empty() ? "-" : fmt::format("{}", fmt::join(stops, ", "))};
}

std::string shown_phase(const json& mission) {
  return text_at(mission, "phase") + (mission.at("paused").get<bool>() ? ", paused" : "");
}

std::string joined(const json& texts) {
  std::vector<std::string> all;
  for (const json& one : texts) all.push_back(text_of(one));
  return fmt::format("{}", fmt::join(all, ", "));
}

std::string finding_line(const json& finding) {
  return fmt::format("  {}: {}\n", finding.at("forbids").get<bool>() ? "forbids its start" : "warning",
                     text_at(finding, "words"));
}

bool is_down(const json& drone) {
  const std::string phase = text_at(drone, "link_phase");
  return phase == "on_ground" || phase == "landed";
}

}  // namespace

std::string of_drone(const std::string& name, std::string text) {
  const std::string prefix = name + ": ";
  while (text.starts_with(prefix)) text.erase(0, prefix.size());
  for (auto at = text.find(": " + prefix); at != std::string::npos; at = text.find(": " + prefix, at))
    text.erase(at + 2, prefix.size());
  return prefix + text;
}

std::string aligned(const Rows& rows) {
  std::vector<std::size_t> widths;
  for (const auto& row : rows) {
    widths.resize(std::max(widths.size(), row.size()));
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], width(row[i]));
  }
  std::string text;
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      text += row[i];
      if (i + 1 < row.size()) text.append(widths[i] - width(row[i]) + 2, ' ');
    }
    text += '\n';
  }
  return text;
}

Result<Rows> drone_rows(std::string_view body) {
  return read_answer<Rows>(body, "drones", [](const json& read) {
    Rows rows{{"drone", "phase", "failsafe", "battery", "age", "position m", "lease", "requested by", "stopped by"}};
    for (const json& drone : read.at("drones")) rows.push_back(drone_row(drone));
    return rows;
  });
}

Result<crypto::IdentityName> only_requester(std::string_view body, const std::string& name) {
  Status found = done;
  auto requester = read_answer<crypto::IdentityName>(body, "drones", [&](const json& read) {
    for (const json& drone : read.at("drones")) {
      if (text_at(drone, "name") != name) continue;
      const json& requests = drone.at("requests");
      if (requests.size() == 1)
        return crypto::IdentityName{text_at(requests[0], "msp"), text_at(requests[0], "subject")};
      found = Error{requests.empty() ? fmt::format("{}: nobody has requested it", name)
                                     : fmt::format("{}: {} have requested it: name one by --msp and --subject", name,
                                                   requests.size())};
      return crypto::IdentityName{};
    }
    found = Error{fmt::format("{}: this station does not fly it", name)};
    return crypto::IdentityName{};
  });
  if (requester && !found) return found.error();
  return requester;
}

Rows settled(Rows rows) {
  for (auto& row : rows) {
    if (row.size() > age_column) row[age_column].clear();
  }
  return rows;
}

bool has_an_end(std::string_view verb) {
  return verb == "takeoff" || verb == "land" || verb == "stop" || verb == "cut";
}

Result<bool> all_arrived(std::string_view body, const std::vector<std::string>& names, std::string_view verb) {
  Status failed = done;
  auto arrived = read_answer<bool>(body, "drones", [&](const json& answer) {
    bool all = true;
    for (const json& drone : answer.at("drones")) {
      const std::string name = text_at(drone, "name");
      if (!names.empty() && std::ranges::find(names, name) == names.end()) continue;
      if (verb == "takeoff" && text_at(drone, "phase") == "failed")
        failed = Error{fmt::format("{}: failed: {}", name, mode_of(drone))};
      const bool is_stop = verb == "stop" || verb == "cut";
      all = all && (verb == "takeoff" ? text_at(drone, "link_phase") == "flying"
                                      : is_down(drone) && (!is_stop || !drone.at("stopped_by").empty()));
    }
    return all;
  });
  if (!failed) return failed.error();
  return arrived;
}

Result<std::vector<std::string>> drones_for(std::string_view body, std::string_view verb, const std::string& self) {
  return read_answer<std::vector<std::string>>(body, "drones", [&](const json& answer) {
    std::vector<std::string> names;
    for (const json& drone : answer.at("drones")) {
      const std::string holder = text_at(drone.at("lease"), "holder");
      const bool fits = verb == "clear_stop" ? !drone.at("stopped_by").empty()
                        : verb == "acquire"  ? holder.empty()
                        : verb == "request"  ? !holder.empty() && holder != self
                        : verb == "release"  ? holder == self
                                             : !is_down(drone);
      if (fits) names.push_back(drone.at("name").get<std::string>());
    }
    return names;
  });
}

Result<bool> is_cleared(std::string_view body, const std::string& name) {
  const auto stopped = drones_for(body, "clear_stop", "");
  if (!stopped) return stopped.error();
  return std::ranges::find(*stopped, name) == stopped->end();
}

Result<bool> is_flown(std::string_view body) {
  Status ended = done;
  auto flown = read_answer<bool>(body, "a mission", [&](const json& mission) {
    const std::string phase = text_at(mission, "phase");
    if (phase == "aborted") ended = Error{fmt::format("aborted: {}", text_at(mission, "why"))};
    return phase == "done";
  });
  if (!ended) return ended.error();
  return flown;
}

Result<Rows> mission_rows(std::string_view body) {
  return read_answer<Rows>(body, "missions", [](const json& read) {
    Rows rows{{"id", "name", "phase", "approvals", "drones", "why"}};
    for (const json& mission : read.at("missions")) {
      std::string why = text_at(mission, "why");
      for (const json& finding : mission.at("findings"))
        if (why.empty() && finding.at("forbids").get<bool>()) why = text_at(finding, "words");
      rows.push_back(
          {text_at(mission, "id"), text_at(mission, "name"), shown_phase(mission),
           fmt::format("{} of {}", mission.at("approvals").size(), mission.at("approvals_needed").get<int>()),
           joined(mission.at("drones")), why.empty() ? "-" : why});
    }
    return rows;
  });
}

Result<std::string> mission_with(std::string_view body, const std::string& digest) {
  return read_answer<std::string>(body, "missions", [&](const json& read) {
    for (const json& mission : read.at("missions")) {
      if (text_at(mission, "hash") == digest) return mission.dump(-1, ' ', false, json::error_handler_t::replace);
    }
    return std::string();
  });
}

Result<std::string> mission_text(std::string_view body) {
  return read_answer<std::string>(body, "a mission", [](const json& mission) {
    const std::string by = text_at(mission, "by"), why = text_at(mission, "why"),
                      approvals = joined(mission.at("approvals"));
    std::string text = fmt::format("{} {}: {}{}\n", text_at(mission, "id"), text_at(mission, "name"),
                                   shown_phase(mission), why.empty() ? "" : ": " + why);
    text += fmt::format("  digest {}\n  drones {}\n", text_at(mission, "hash"), joined(mission.at("drones")));
    text += fmt::format("  approved by {} of {}{}\n", mission.at("approvals").size(),
                        mission.at("approvals_needed").get<int>(), approvals.empty() ? "" : ": " + approvals);
    if (!by.empty()) text += fmt::format("  of {}\n", by);
    for (const auto& [drone, count] : mission.at("reached").items())
      text += fmt::format("  {} has reached {} waypoints\n", printable(drone), count.get<std::size_t>());
    for (const json& finding : mission.at("findings")) text += finding_line(finding);
    if (const auto paths = mission.find("paths"); paths != mission.end()) {
      for (const auto& [drone, path] : paths->items())
        text += fmt::format("  {} flies {} waypoints\n", printable(drone), path.size());
    }
    return text;
  });
}

std::string digests_text(const MissionDigests& digests) {
  const std::string text = fmt::format("mission {}\n  digest {}\n", digests.name, digests.digest);
  if (digests.words.empty()) return text;
  return text + fmt::format("  \"{}\", SHA-256 {}\n  withdrawn: SHA-256 {}\n", digests.words, digests.approval,
                            digests.withdrawal);
}

std::string digests_json(const MissionDigests& digests, const std::string& at_station) {
  json all{{"name", digests.name}, {"digest", digests.digest}, {"at_station", json::parse(at_station)}};
  if (!digests.words.empty())
    all.update({{"words", digests.words}, {"approval", digests.approval}, {"withdrawal", digests.withdrawal}});
  return all.dump();
}

Result<Approvals> approvals_from(std::string_view body) {
  return read_answer<Approvals>(body, "a mission", [](const json& mission) {
    return Approvals{text_at(mission, "name"), mission.at("approvals").get<std::vector<std::string>>()};
  });
}

bool is_anchored_already(std::string_view text) { return text.find(anchored_already) != std::string_view::npos; }

bool counts_already(const Approvals& approvals, std::string_view text) {
  return std::ranges::any_of(approvals.signers, [&](const std::string& signer) {
    return text.find(signer + std::string(anchored_already)) != std::string_view::npos;
  });
}

Result<std::vector<ShownEvent>> events_from(std::string_view body) {
  return read_answer<std::vector<ShownEvent>>(body, "events", [](const json& read) {
    std::vector<ShownEvent> all;
    for (const json& event : read.at("events"))
      all.push_back({event.at("n").get<std::uint64_t>(), event.at("t_ms").get<double>(), text_at(event, "level"),
                     text_at(event, "drone"), text_at(event, "text")});
    return all;
  });
}

Result<double> now_ms_from(std::string_view body) {
  return read_answer<double>(body, "events", [](const json& read) { return read.at("t_ms").get<double>(); });
}

std::string event_line(const ShownEvent& event, const std::string& time) {
  return fmt::format("{}  {:<7}  {}{}", time, event.level, event.drone.empty() ? "" : event.drone + ": ", event.text);
}

namespace {

bool in_air(const std::string& phase) {
  return phase == "takeoff" || phase == "path" || phase == "manual" || phase == "landing";
}

bool under_way(const std::string& phase) { return phase == "taking_off" || phase == "to_start" || phase == "flying"; }

/// When each drone last took off, ground's clock [ms].
std::map<std::string, double> takeoffs_of(const std::vector<ShownEvent>& events) {
  std::map<std::string, double> all;
  for (const ShownEvent& event : events) {
    if (event.text == "takeoff") all[event.drone] = event.t_ms;
  }
  return all;
}

}  // namespace

Result<std::vector<ActiveFlight>> active_flights_from(std::string_view drones, std::string_view missions,
                                                      const std::vector<ShownEvent>& events, double t_ms) {
  const auto takeoffs = takeoffs_of(events);
  std::map<std::string, json> flying;
  const auto read = read_answer<bool>(drones, "drones", [&](const json& answer) {
    for (const json& drone : answer.at("drones")) {
      if (in_air(text_at(drone, "phase"))) flying[text_at(drone, "name")] = drone;
    }
    return true;
  });
  if (!read) return read.error();
  const auto since = [&](const std::vector<std::string>& names) -> std::optional<double> {
    std::optional<double> first_ms;
    for (const std::string& name : names) {
      const auto found = takeoffs.find(name);
      if (flying.contains(name) && found == takeoffs.end()) return std::nullopt;
      if (flying.contains(name)) first_ms = std::min(first_ms.value_or(found->second), found->second);
    }
    return first_ms ? std::optional((t_ms - *first_ms) / 1e3) : std::nullopt;
  };
  std::set<std::string> taken;
  auto all = read_answer<std::vector<ActiveFlight>>(missions, "missions", [&](const json& answer) {
    std::vector<ActiveFlight> found;
    for (const json& mission : answer.at("missions")) {
      const std::string phase = text_at(mission, "phase");
      if (!under_way(phase)) continue;
      ActiveFlight one{.what = "mission", .mission = text_at(mission, "id"), .name = text_at(mission, "name")};
      for (const json& name : mission.at("drones")) one.drones.push_back(text_of(name));
      taken.insert(one.drones.begin(), one.drones.end());
      one.phase = phase + (mission.at("paused").get<bool>() ? ", paused" : "");
      one.by = text_at(mission, "by");
      one.since_s = since(one.drones);
      found.push_back(std::move(one));
    }
    return found;
  });
  if (!all) return all;
  return read_answer<std::vector<ActiveFlight>>(drones, "drones", [&](const json&) {
    for (const auto& [name, drone] : flying) {
      if (taken.contains(name)) continue;
      const std::string phase = text_at(drone, "phase"), by = text_at(drone.at("lease"), "holder");
      all->push_back({.what = phase == "path" ? "path" : "hand",
                      .mission = {},
                      .name = {},
                      .drones = {name},
                      .phase = phase + (drone.at("paused").get<bool>() ? ", paused" : ""),
                      .by = by,
                      .since_s = since({name})});
    }
    return std::move(*all);
  });
}

Rows active_flight_rows(const std::vector<ActiveFlight>& flown) {
  Rows rows{{"flown", "drones", "phase", "since", "by"}};
  for (const ActiveFlight& one : flown) {
    rows.push_back({one.what == "mission" ? fmt::format("mission {} ({})", one.name, one.mission) : "by " + one.what,
                    fmt::format("{}", fmt::join(one.drones, ", ")), one.phase,
                    one.since_s ? fmt::format("{:.0f} s", *one.since_s) : "-", one.by.empty() ? "-" : one.by});
  }
  return rows;
}

std::string active_flights_json(const std::vector<ActiveFlight>& flown) {
  json all = json::array();
  for (const ActiveFlight& one : flown) {
    json row{{"what", one.what}, {"drones", one.drones}, {"phase", one.phase}, {"by", one.by}};
    if (one.what == "mission") row.update({{"mission", one.mission}, {"name", one.name}});
    row["since_s"] = one.since_s ? json(*one.since_s) : json();
    all.push_back(std::move(row));
  }
  return json{{"flights", all}}.dump();
}

}  // namespace ledgerline::station
