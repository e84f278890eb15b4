#include "ground/json/strict.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <vector>

#include "common/base/printable.hpp"

namespace ledgerline::ground::json {

using Json = nlohmann::json;

Result<Json> object_from(std::string_view text, std::string_view what, int max_depth) {
  if (text.empty()) return Json::object();
  bool too_deep = false;
  std::string twice;
  std::vector<std::set<std::string>> keys;  // of the objects that are open
  const auto bounded = [&](int depth, Json::parse_event_t event, Json& parsed) {
    too_deep = too_deep || depth > max_depth;
    if (too_deep) return false;
    if (event == Json::parse_event_t::object_start) keys.emplace_back();
    if (event == Json::parse_event_t::object_end) keys.pop_back();
    if (event == Json::parse_event_t::key && !keys.back().insert(parsed.get_ref<const std::string&>()).second)
      twice = parsed.get_ref<const std::string&>();
    return true;
  };
  Json parsed = Json::parse(text, bounded, false);
  if (too_deep || parsed.is_discarded() || !parsed.is_object())
    return Error{fmt::format("{} must be a JSON object that nests at most {} deep", what, max_depth)};
  if (!twice.empty()) return Error{fmt::format("{} has the key \"{}\" twice", what, printable(twice, max_shown))};
  return parsed;
}

Status only(const Json& object, std::initializer_list<std::string_view> allowed) {
  for (const auto& [key, value] : object.items()) {
    if (std::find(allowed.begin(), allowed.end(), key) == allowed.end())
      return Error{"unknown key \"" + printable(key, max_shown) + "\""};
  }
  return done;
}

Result<motion::Waypoint> waypoint_from(const Json& given) {
  if (!given.is_object()) return Error{"must be an object"};
  if (const Status keys = only(given, {"x", "y", "z", "speed"}); !keys) return keys.error();
  for (const auto& [key, value] : given.items()) {
    if (!value.is_number()) return Error{key + " must be a number"};
  }
  if (!given.contains("x") || !given.contains("y")) return Error{"needs x and y"};
  motion::Waypoint waypoint;
  waypoint.at_m = {given["x"].get<double>(), given["y"].get<double>()};
  if (given.contains("z")) waypoint.height_m = given["z"].get<double>();
  if (given.contains("speed")) waypoint.speed_mps = given["speed"].get<double>();
  return waypoint;
}

std::string dump(const Json& value) { return value.dump(-1, ' ', false, Json::error_handler_t::replace); }

Result<bool> land_behind_from(const Json& then) {
  if (then != "hover" && then != "land") return Error{R"(then must be "hover" or "land")"};
  return then == "land";
}

}  // namespace ledgerline::ground::json
