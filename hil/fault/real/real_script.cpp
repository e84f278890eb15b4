#include "hil/fault/real/real_script.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "common/config/config.hpp"
#include "hil/fault/own_code.hpp"
#include "hil/fault/real/sdk_flight.hpp"
#include "hil/netem/text_parse.hpp"
#include "hil/sitl/world_setup.hpp"

namespace ledgerline::hil {
namespace {

constexpr double min_side_m = 0.5, max_side_m = 15;  // of tools/launcher/options.cpp

std::string way_of(DroneTraffic traffic) {
  return traffic == DroneTraffic::to ? "to" : traffic == DroneTraffic::answers ? "answers" : "state";
}

std::string all_of_it(const Impairment& impairment) {
  return impairment.any() ? "clear, " + text_of(impairment) : "clear";
}

Effects effects_of(const std::vector<Fault>& faults, int drones) {
  Effects effects(static_cast<std::size_t>(drones));
  for (const Fault& fault : faults) {
    if (fault.acts.lasts) fault.acts.lasts(effects);
    for (int k = 1; k <= drones; ++k) {
      if (fault.acts.lasts_on && fault.names(drone_name(k)))
        fault.acts.lasts_on(effects.drones[static_cast<std::size_t>(k) - 1], 0);
    }
  }
  return effects;
}

/// One way of a connection to the ledger. A cut: nothing comes up again until it is over.
Impairment of_way(const Effects::OfPort& port, bool to) {
  Impairment all;
  all.delay = to ? port.delay_to : port.delay_from;
  all.stall = to ? port.stall_to : port.stall_from;
  all.partition = port.cut;
  return all;
}

/// The directions that a fault is about, each with all that lies upon it now.
RealActs set_proxy(const Fault& changed, const std::vector<Fault>& active, int drones) {
  RealActs acts;
  const Effects touched = effects_of({changed}, drones), all = effects_of(active, drones);
  for (int k = 1; k <= drones; ++k) {
    const auto i = static_cast<std::size_t>(k) - 1;
    for (const DroneTraffic traffic : {DroneTraffic::to, DroneTraffic::answers, DroneTraffic::states}) {
      if (touched.drones[i].impairment(traffic).any())
        acts.proxy.push_back(fmt::format("drone {} {} {}", drone_name(k), way_of(traffic),
                                         all_of_it(all.drones[i].impairment(traffic))));
    }
  }
  for (const Process process : {Process::agent, Process::ground}) {
    for (const bool to : {true, false}) {
      if (!of_way(touched.port(process), to).any()) continue;
      acts.proxy.push_back(fmt::format("server {} {} {}", servers_of(process), to ? "to" : "from",
                                       all_of_it(of_way(all.port(process), to))));
    }
  }
  return acts;
}

}  // namespace

std::vector<NotReal> not_real(const Script& script, const RealStack& stack) {
  std::vector<NotReal> reasons;
  if (script.kind == FlightKind::sdk) {
    reasons = not_by_sdk(script);
    if (stack.shim)
      reasons.push_back({"flight.kind", "an SDK client speaks UDP: it is flown over the proxy, without --shim"});
    return reasons;
  }
  const WorldConfig usual, &flight = script.flight;
  const auto refuse = [&](const char* key, std::string why) { reasons.push_back({key, std::move(why)}); };
  if (flight.side_m < min_side_m || flight.side_m > max_side_m)
    refuse("flight.side_m", fmt::format("./fly flies paths of {} to {} m a side", min_side_m, max_side_m));
  for (const auto& [number, task] : flight.tasks) {
    if (task.waypoints.empty() && (task.side_m < min_side_m || task.side_m > max_side_m))
      refuse("task",
             fmt::format("{}: ./fly flies paths of {} to {} m a side", drone_name(number), min_side_m, max_side_m));
  }
  if (flight.battery != usual.battery) refuse("flight.battery", "./fly flies with full batteries");
  if (flight.pose == link::PoseSource::pads) refuse("flight.pose", "./fly lays no pads for it");
  if (flight.calibrated) refuse("flight.calibrated", "./fly's drones are not");
  if (!flight.pads.empty()) refuse("flight.pads", "./fly lays none");
  if (flight.yaw_deg != usual.yaw_deg) refuse("flight.yaw_deg", "./fly's drones look along x");
  if (flight.drawn_tello) refuse("flight.tello", "./fly flies the usual Tello");
  if (flight.wifi) refuse("flight.wifi", "a fault's recorded-day does it");
  if (!flight.keeps_rc) refuse("flight.keeps_rc", "./fly flies the usual Tello");
  if (!flight.command_counts) refuse("flight.command_counts", "./fly flies the usual Tello");
  if (flight.room_m != usual.room_m) refuse("flight.room_m", "./fly flies with the usual fence");
  if (flight.blocks != usual.blocks)
    refuse("flight.blocks", "./fly's ledger has no orderer that lies; --blocks ordered flies so without");
  if (flight.idle_evict_ns != usual.idle_evict_ns) refuse("flight.idle_evict", "./fly's agent has the usual one");
  if (flight.on_untrusted_ledger != usual.on_untrusted_ledger)
    refuse("flight.on_untrusted_ledger", "./fly's link ignores an untrusted ledger");
  for (std::size_t i = 0; i < script.faults.size(); ++i) {
    const Fault& fault = script.faults[i];
    if (const Status real = fault.acts.check_real(fault, stack); !real)
      reasons.push_back({fmt::format("fault.{}.what", i), fmt::format("\"{}\": {}", fault.text, real.error().message)});
  }
  for (const Rule& rule : script.must) {
    if (const auto why = rule.kind->not_real; !why.empty())
      reasons.push_back({"must", fmt::format("\"{}\": {}", rule.text, why)});
  }
  return reasons;
}

Status check_real(const Script& script, const RealStack& stack, const OwnCode& own) {
  std::vector<std::string> lines;
  if (script.kind != FlightKind::path && own.program.empty())
    lines.push_back(fmt::format("flight.kind: \"{}\" needs --program, which flies it", name_of(script.kind)));
  for (const NotReal& reason : not_real(script, stack)) lines.push_back(fmt::format("{}: {}", reason.key, reason.what));
  if (lines.empty()) return done;
  return Error{fmt::format("{} cannot be flown with the real processes:\n  {}", script.name, fmt::join(lines, "\n  "))};
}

std::vector<std::string> fly_arguments(const Script& script, std::uint64_t seed, const RealStack& stack) {
  const WorldConfig& flight = script.flight;
  std::vector<std::string> arguments{"--proxy"};
  const auto add = [&](const char* option, std::string value) {
    arguments.insert(arguments.end(), {option, std::move(value)});
  };
  add("--drones", std::to_string(flight.drones));
  add("--max-age", fmt::format("{}ms", flight.max_age_ns / ns_per_ms));
  add("--speed", fmt::format("{:g}", flight.speed_mps));
  add("--rate", fmt::format("{:g}", flight.rate_hz));
  add("--batch-count", std::to_string(flight.batch_count));
  add("--batch-timeout", fmt::format("{}ms", flight.batch_timeout_ns / ns_per_ms));
  add("--seed", std::to_string(seed));
  if (flight.pose != link::PoseSource::mocap) add("--pose", name(flight.pose));
  if (flight.manual) {
    add("--shape", "manual");
    add("--seconds", fmt::format("{:g}", flight.seconds));
  } else {
    if (flight.waypoints.empty()) add("--shape", ground::name_of(flight.shape));
    add("--side", fmt::format("{:g}", flight.side_m));
    add("--laps", std::to_string(flight.laps));
    if (!flight.predict) add("--predict", "off");
  }
  if (stack.shim) arguments.emplace_back("--shim");
  if (stack.fabric)
    arguments.insert(arguments.end(), {"--ledger", "fabric", "--orderers", std::to_string(fabric_orderers)});
  return arguments;
}

RealActs acts_at_begin(const Fault& fault, const std::vector<Fault>& active, int drones, const RealStack& stack) {
  RealActs acts = set_proxy(fault, active, drones);
  if (fault.acts.really_begin) fault.acts.really_begin(acts, stack);
  return acts;
}

RealActs acts_at_end(const Fault& fault, const std::vector<Fault>& active, int drones, const RealStack& stack) {
  RealActs acts = set_proxy(fault, active, drones);
  const bool goes_on =
      std::any_of(active.begin(), active.end(), [&](const Fault& other) { return other.text == fault.text; });
  if (fault.acts.really_end) fault.acts.really_end(acts, stack, goes_on);
  return acts;
}

Result<Script> check_script(std::string_view toml, const std::string& file, const std::optional<RealStack>& real) {
  auto script = parse_script(toml, file, true);
  const bool only_real = script && !check_sitl(*script);
  if (!real && !only_real) return parse_script(toml, file);
  if (!script) return script;
  auto config = Config::parse(toml, file);  // it knows the lines
  if (!config) return config.error();
  (void)read_script(*config, file, true);
  for (const NotReal& reason : not_real(*script, real.value_or(RealStack{}))) config->wrong(reason.key, reason.what);
  if (auto status = config->finish(); !status) return status.error();
  return script;
}

}  // namespace ledgerline::hil
