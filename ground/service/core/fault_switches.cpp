#include "ground/service/core/fault_switches.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "common/msg/contract.hpp"
#include "ground/json/strict.hpp"

namespace ledgerline::ground::service {
namespace {

namespace strict = ground::json;
using nlohmann::json;

constexpr std::size_t max_fault_name = 64, max_fault_words = 300;
constexpr strict::Bounds list_bounds{1'048'576, 3, 16 * max_fault_switches + 2};

bool is_fault_name(const std::string& text) {
  const auto allowed = [](char c) { return contract::is_alphanumeric(c) || c == '-' || c == '_'; };
  return !text.empty() && text.size() <= max_fault_name && std::ranges::all_of(text, allowed);
}

json switches_json(const FaultList& list) {
  json all = json::array();
  for (const FaultSwitch& one : list.switches) {
    all.push_back(
        {{"name", one.name}, {"drone", one.drone}, {"label", one.label}, {"words", one.words}, {"on", one.on}});
  }
  return all;
}

Result<FaultSwitch> switch_from(const json& given) {
  if (!given.is_object()) return Error{"is no object"};
  if (const Status keys = strict::only(given, {"name", "drone", "label", "words", "on"}); !keys) return keys.error();
  FaultSwitch made;
  for (const auto& [key, to] : {std::pair("name", &made.name), std::pair("drone", &made.drone),
                                std::pair("label", &made.label), std::pair("words", &made.words)}) {
    const json text = given.value(key, json());
    if (!text.is_string() || text.get_ref<const std::string&>().size() > max_fault_words)
      return Error{fmt::format("{} is no text of at most {} bytes", key, max_fault_words)};
    *to = text.get<std::string>();
  }
  const json on = given.value("on", json());
  if (!on.is_boolean()) return Error{"on is neither true nor false"};
  made.on = on.get<bool>();
  if (!is_fault_name(made.name)) return Error{"name is no word of a-z, A-Z, 0-9, - and _"};
  return made;
}

}  // namespace

Result<std::vector<FaultSwitch>> faults_from(std::string_view text) {
  const auto object = strict::object_from(text, "the list of faults", list_bounds);
  if (!object) return object.error();
  if (const Status keys = strict::only(*object, {"faults"}); !keys) return keys.error();
  const json list = object->value("faults", json());
  if (!list.is_array() || list.size() > max_fault_switches)
    return Error{fmt::format("faults is no list of at most {}", max_fault_switches)};
  std::vector<FaultSwitch> all;
  std::set<std::string> names;
  for (const json& given : list) {
    auto one = switch_from(given);
    if (!one) return Error{fmt::format("fault {}: {}", all.size() + 1, one.error().message)};
    if (!names.insert(one->name).second) return Error{fmt::format("there are two faults {}", one->name)};
    all.push_back(std::move(*one));
  }
  return all;
}

std::string faults_text(const FaultList& list) { return strict::dump({{"faults", switches_json(list)}}); }

std::string faults_message(const FaultList& list) {
  return strict::dump({{"op", "faults"}, {"faults", switches_json(list)}, {"why", list.why}});
}

std::string command_of(const FaultRequest& ask) { return (ask.on ? "on " : "off ") + ask.name; }

std::string words_of(const FaultRequest& ask, const FaultSwitch& what) {
  return fmt::format("{}: switched {}{}{}", what.label, ask.on ? "on" : "off", ask.by.empty() ? "" : " by ", ask.by);
}

}  // namespace ledgerline::ground::service
