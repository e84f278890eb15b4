#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "common/base/enum_count.hpp"
#include "common/base/printable.hpp"
#include "ground/json/strict.hpp"
#include "ground/mission/parse.hpp"
#include "ground/mission/run.hpp"

/// MissionRun, continued: kept as text, and made of it again.
namespace ledgerline::ground::mission {
namespace {

using nlohmann::json;
namespace strict = ground::json;

constexpr int version = 1;
// A mission, one deeper, and five values of each drone.
constexpr strict::Bounds saved_bounds{MissionRun::max_saved_bytes, 6,
                                      (5 * motion::max_waypoints + 20) * max_drones + 20};

template <typename Names>
std::optional<std::size_t> index_in(const Names& names, const json& name) {
  if (!name.is_string()) return std::nullopt;
  const auto found = std::find(names.begin(), names.end(), name.get_ref<const std::string&>());
  if (found == names.end()) return std::nullopt;
  return static_cast<std::size_t>(found - names.begin());
}

Result<RunPhase> phase_from(const json& name) {
  for (std::size_t i = 0; i < enum_count<RunPhase>; ++i) {
    if (name == name_of(static_cast<RunPhase>(i))) return static_cast<RunPhase>(i);
  }
  return Error{"phase must be one of a mission's"};
}

}  // namespace

const std::vector<std::string_view>& MissionRun::leg_names() {
  constexpr std::array words{"standing", "rising", "ready",   "ordered", "flying",
                             "halted",   "ended",  "landing", "landed",  "lost"};
  static_assert(words.size() == enum_count<Leg>);
  static const std::vector<std::string_view> names(words.begin(), words.end());
  return names;
}

// All but the mission.
std::string MissionRun::saved_state() const {
  json drones = json::array();
  for (std::size_t i = 0; i < parts_.size(); ++i)
    drones.push_back({{"drone", name(i)},
                      {"leg", leg_names()[static_cast<std::size_t>(parts_[i].leg)]},
                      {"reached", parts_[i].reached},
                      {"to_land", parts_[i].landing_due}});
  const json state{{"version", version},
                   {"phase", name_of(phase_)},
                   {"paused", paused_},
                   {"why", why_},
                   {"drones", std::move(drones)}};
  return state.dump();
}

std::string MissionRun::saved() const {
  std::string text = saved_state();
  text.back() = ',';
  return text + R"("mission":)" + canonical_ + "}";
}

Status MissionRun::restore_part(const nlohmann::json& given, std::size_t drone) {
  if (!given.is_object()) return Error{"must be an object"};
  if (const Status keys = strict::only(given, {"drone", "leg", "reached", "to_land"}); !keys) return keys;
  if (given.value("drone", json()) != name(drone)) return Error{fmt::format("must be {}", name(drone))};
  const auto leg = index_in(leg_names(), given.value("leg", json()));
  if (!leg) return Error{"leg must be one of a mission's"};
  const json reached = given.value("reached", json());
  const std::size_t count = mission_.drones[drone].waypoints.size();
  if (!reached.is_number_unsigned() || reached.get<std::uint64_t>() > count)
    return Error{fmt::format("reached must be 0 to {}", count)};
  const json to_land = given.value("to_land", json());
  if (!to_land.is_boolean()) return Error{"to_land must be true or false"};
  Part& part = parts_[drone];
  part.to_land = part.landing_due = to_land.get<bool>();
  part.leg = static_cast<Leg>(*leg);
  part.reached = reached.get<std::size_t>();
  const bool at_end = part.leg == Leg::ended || part.leg == Leg::landing || part.leg == Leg::landed;
  if (part.leg != Leg::lost && at_end != (part.reached == count))
    return Error{fmt::format("leg {} does not go with {} of {} waypoints", leg_names()[*leg], part.reached, count)};
  if (part.leg == Leg::landing && !mission_.drones[drone].land_behind)
    return Error{"leg landing does not go with a path that ends in hovering"};
  // What was in progress starts again from where it is.
  if (part.leg == Leg::rising) part.leg = Leg::ready;
  if (part.leg == Leg::ordered || part.leg == Leg::flying) part.leg = Leg::halted;
  part.found = part.leg == Leg::standing || part.leg == Leg::landed || part.leg == Leg::lost;
  return ledgerline::done;
}

Result<MissionRun> MissionRun::restore(std::string_view text, const RunConfig& config) {
  const auto wrong = [](const std::string& what) { return Error{"the kept mission: " + what}; };
  if (text.size() > max_saved_bytes) return wrong(fmt::format("has {} bytes; {} may be", text.size(), max_saved_bytes));
  const auto parsed = strict::object_from(text, "the kept mission", saved_bounds);
  if (!parsed) return parsed.error();
  if (const Status keys = strict::only(*parsed, {"version", "mission", "phase", "paused", "why", "drones"}); !keys)
    return wrong(keys.error().what);
  if (parsed->value("version", json()) != version) return wrong(fmt::format("version must be {}", version));
  auto mission = mission_from_json(parsed->value("mission", json()));
  if (!mission) return wrong(mission.error().what);
  auto run = make(std::move(*mission), config);
  if (!run) return run.error();
  const auto phase = phase_from(parsed->value("phase", json()));
  if (!phase) return wrong(phase.error().what);
  const json paused = parsed->value("paused", json()), why = parsed->value("why", json());
  if (!paused.is_boolean() || !why.is_string()) return wrong("paused must be true or false, why a text");
  const json drones = parsed->value("drones", json());
  if (!drones.is_array() || drones.size() != run->parts_.size())
    return wrong(fmt::format("drones must be a list of {}", run->parts_.size()));
  for (std::size_t i = 0; i < drones.size(); ++i) {
    if (const Status part = run->restore_part(drones[i], i); !part)
      return wrong(fmt::format("drone number {}: {}", i + 1, part.error().what));
  }
  // Approvals are the ledger's to say.
  run->phase_ = *phase == RunPhase::approved ? RunPhase::checked : *phase;
  run->paused_ = run->active() && paused.get<bool>();
  run->why_ = printable(why.get<std::string>());
  run->recovering_ = run->active();
  // Of an aborted one those land that were not seen to; of another one that is for its rules.
  if (run->phase_ != RunPhase::aborted) {
    for (Part& part : run->parts_) part.to_land = part.landing_due = false;
  }
  return run;
}

}  // namespace ledgerline::ground::mission
