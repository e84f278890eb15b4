#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <set>

#include "tools/station/core/read.hpp"
#include "tools/station/core/show.hpp"

namespace ledgerline::station {
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

Result<std::vector<Flown>> flown_from(std::string_view drones, std::string_view missions,
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
  auto all = read_answer<std::vector<Flown>>(missions, "missions", [&](const json& answer) {
    std::vector<Flown> found;
    for (const json& mission : answer.at("missions")) {
      const std::string phase = text_at(mission, "phase");
      if (!under_way(phase)) continue;
      Flown one{.what = "mission", .mission = text_at(mission, "id"), .name = text_at(mission, "name")};
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
  return read_answer<std::vector<Flown>>(drones, "drones", [&](const json&) {
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

Rows flown_rows(const std::vector<Flown>& flown) {
  Rows rows{{"flown", "drones", "phase", "since", "by"}};
  for (const Flown& one : flown) {
    rows.push_back({one.what == "mission" ? fmt::format("mission {} ({})", one.name, one.mission) : "by " + one.what,
                    fmt::format("{}", fmt::join(one.drones, ", ")), one.phase,
                    one.since_s ? fmt::format("{:.0f} s", *one.since_s) : "-", one.by.empty() ? "-" : one.by});
  }
  return rows;
}

std::string flown_json(const std::vector<Flown>& flown) {
  json all = json::array();
  for (const Flown& one : flown) {
    json row{{"what", one.what}, {"drones", one.drones}, {"phase", one.phase}, {"by", one.by}};
    if (one.what == "mission") row.update({{"mission", one.mission}, {"name", one.name}});
    row["since_s"] = one.since_s ? json(*one.since_s) : json();
    all.push_back(std::move(row));
  }
  return json{{"flights", all}}.dump();
}

}  // namespace ledgerline::station
