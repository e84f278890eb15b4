#include "tools/launcher/preflight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/common.pb.h"
#include "common/fabric/validation/channel_config.hpp"
#include "common/msg/proto_json.hpp"
#include "sim/core/parameters.hpp"
#include "tools/launcher/configs.hpp"

namespace ledgerline::launcher {
namespace {

using checks::DroneInputs;
using checks::PreflightInputs;
using nlohmann::json;

std::string text_in(const json& object, const char* key, const std::string& otherwise) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : otherwise;
}

void read_drone(const json& one, DroneInputs& drone) {
  const std::string phase = text_in(one, "phase", "disconnected");
  // Of one that is to report its serial nothing counts before that.
  const auto serial = one.find("serial");
  const bool is_asked = drone.wanted_serial.empty() || (serial != one.end() && serial->is_string());
  drone.serial = text_in(one, "serial", "");
  const bool is_diverted = one.value("diverted", json()) == true;
  drone.state_hz = is_diverted ? std::optional(0.0) : std::nullopt;
  drone.there = is_diverted || (phase != "disconnected" && is_asked);
  drone.phase = phase == "on_ground" || phase == "landed" ? "" : phase;
  drone.refusal = text_in(one, "cause", "unknown");
  if (drone.refusal == "none") drone.refusal.clear();
  const auto battery = one.find("battery");
  if (battery != one.end() && battery->is_number() && battery->get<double>() >= 0)
    drone.battery = battery->get<double>();
  const auto temperature = one.find("temperature_c");
  if (temperature != one.end() && temperature->is_number() && temperature->get<double>() != 0)
    drone.temperature_c = temperature->get<double>();
  const auto age_ms = one.find("pose_age_ms");
  const auto position = one.find("position");
  drone.pose.reset();
  if (age_ms == one.end() || !age_ms->is_number() || position == one.end() || !position->is_array()) return;
  drone.pose = checks::PoseInputs{.age_ms = age_ms->get<double>()};
  for (std::size_t k = 0; k < std::min<std::size_t>(3, position->size()); ++k)
    if ((*position)[k].is_number()) drone.pose->position_m[k] = (*position)[k].get<double>();
}

}  // namespace

// Rows of four.
std::vector<Eigen::Vector2d> simulated_starts(const Options& options) {
  const sim::Parameters simulated;
  std::vector<Eigen::Vector2d> starts;
  for (int k = 1; k <= options.drones; ++k)
    starts.push_back(Eigen::Vector3d::Map(sim::start_of(simulated, k).data()).head<2>());
  return starts;
}

Status check_path(const Options& o, const link::FenceSettings& fence, const std::vector<Eigen::Vector2d>& starts) {
  const auto low = Eigen::Vector3d::Map(fence.min_m.data()), high = Eigen::Vector3d::Map(fence.max_m.data());
  for (int k = 1; k <= o.drones; ++k) {
    const DroneTask task = task_of(o, k);
    for (const ground::Waypoint& point : ground::waypoints_of(task.course)) {
      const Eigen::Vector2d at = starts[static_cast<std::size_t>(k) - 1] + point.at_m;
      const Eigen::Vector3d place(at.x(), at.y(), point.height_m.value_or(height_m));
      if ((place.array() >= low.array()).all() && (place.array() <= high.array()).all()) continue;
      return Error{fmt::format(
          "{}: {} would be at {:g}, {:g}, {:g} m, beyond link's fence: x {:g} to {:g}, y {:g} to {:g}, z {:g} "
          "to {:g} m",
          task.course.waypoints.empty()
              ? fmt::format("{} with --side {:g}", ground::name_of(task.course.shape), task.course.side_m)
              : fmt::format("{}:{}", task.file, point.line),
          drone_name(o, k), place.x(), place.y(), place.z(), low.x(), high.x(), low.y(), high.y(), low.z(), high.z())};
    }
  }
  return done;
}

namespace {

/// Whether agent and ground wait for the blocks of a network of others, by the config_block of the deployment's files;
/// without one it is not known, which is a warning. Broken: every command would be too old.
checks::Findings assess_blocks(const Options& options) {
  if (!is_of_others(options)) return {};
  const deployment::OwnLedger& network = *options.own->network;
  const deployment::Timeouts agents = agents_timeouts(options);
  checks::Findings all;
  const auto look = [&](const std::string& key, const std::string& tables, checks::TimeoutInputs inputs) {
    inputs.program = "the file of " + key;
    auto config = Config::parse(tables, key);
    if (!config) return;  // the program's own start says so, and what is wrong with the block
    inputs.of_channel = config->text("ledger.timeouts", "fixed") == "auto";
    const std::string file = config->text("ledger.config_block", "");
    if (file.empty() && !inputs.of_channel)
      all.push_back(flag(checks::Problem::anchor_missing, "blocks",
                         inputs.program + ": whether its blocks come in time is not known"));
    const auto bytes = read_file(file);
    common::Block block;
    if (!bytes || !block.ParseFromString(*bytes)) return;
    const auto channel = fabric::read_channel_config(block);
    if (!channel || !channel->batching) return;
    inputs.deadline_ns = config->integer("ledger.deadline_ms", 1'000, 100, 600'000) * ns_per_ms;
    checks::Finding found = assess(*channel->batching, inputs);
    if (found.problem) {
      const TimeNs longer_ns = fabric::both_ways_ns(channel->batching->timeout_ns, channel->batching->max_messages);
      if (longer_ns < inputs.max_age_ns.value_or(inputs.deadline_ns)) found.severity = checks::Severity::warning;
      found.cure = fmt::format("set timeouts = \"auto\" in [ledger] of {}; or a shorter BatchTimeout", inputs.program);
    }
    all.push_back(std::move(found));
  };
  look("ledger.agent", network.agent,
       {.program = {}, .max_age_ns = agents.max_age_ns, .silent_after_ns = agents.silent_after_ns});
  look("ledger.ground", network.ground, {.program = {}});
  return all;
}

/// Without the time that corners take.
double path_s(const Options& options) {
  constexpr double takeoff_s = 5;
  double max_s = 0;
  for (int k = 1; k <= options.drones && !options.manual; ++k) {
    const ground::Task& course = task_of(options, k).course;
    const ground::Path path(ground::waypoints_of(course), {0, 0});
    max_s = std::max(max_s, takeoff_s + course.laps * path.length_m() / course.speed_mps);
  }
  return max_s;
}

}  // namespace

PreflightInputs inputs_of(const Options& options) {
  PreflightInputs inputs;
  if (!options.own) return inputs;
  const deployment::OwnDrones& own = *options.own;
  for (const deployment::OwnDrone& one : own.drones) {
    DroneInputs drone{.name = one.name, .address = one.address, .interface = one.interface};
    drone.wanted_serial = one.serial;
    inputs.drones.push_back(std::move(drone));
  }
  inputs.link = own.link;
  inputs.path_s = path_s(options);
  inputs.pose_source = own.pose_source;
  inputs.pose_topic = own.pose_topic;
  inputs.stamps_count = own.pose_stamps_count;
  inputs.enrols = !own.network || !own.network->admin.empty();
  inputs.blocks = assess_blocks(options);
  inputs.ledger.what = own.network ? "a network of others" : deployment::name_of(own.ledger);
  return inputs;
}

Status check_path(const Options& options, const PreflightInputs& inputs) {
  if (options.manual || !options.own) return done;
  std::vector<Eigen::Vector2d> starts;
  for (const DroneInputs& drone : inputs.drones) {
    if (!drone.pose) return done;
    starts.emplace_back(drone.pose->position_m[0], drone.pose->position_m[1]);
  }
  return check_path(options, inputs.link.fence, starts);
}

Preflight::Preflight(const Options& options) : options_(options), inputs_(inputs_of(options)) {}

void Preflight::on_status(const std::string& line) {
  const json message = json::parse(line, nullptr, false);
  const json link = message.is_object() ? message.value("link", json()) : json();
  const json list = link.is_object() ? link.value("drones", json()) : json();
  for (const json& one : list.is_array() ? list : json::array()) {
    if (!one.is_object()) continue;
    for (DroneInputs& drone : inputs_.drones)
      if (text_in(one, "name", "") == drone.name) read_drone(one, drone);
  }
}

Status read_records(const std::string& line, const crypto::IdentityName& self, PreflightInputs& inputs) {
  Controls records;
  if (!is_json(line)) return Error{"no control records: " + printable(line)};
  if (auto status = parse_message(line, records); !status) return status;
  for (DroneInputs& drone : inputs.drones) {
    drone.lease = checks::LeaseInputs{.drone = drone.name, .self = self, .control = {}, .enrols = inputs.enrols};
    for (const Control& record : records.controls())
      if (record.drone() == drone.name) drone.lease->control = record;
  }
  return done;
}

Status Preflight::read_records(const std::string& line, const crypto::IdentityName& self) {
  return launcher::read_records(line, self, inputs_);
}

void Preflight::acquired() {
  inputs_.ledger.state = checks::LedgerInputs::State::reached;
  for (DroneInputs& drone : inputs_.drones) {
    if (!acquires(drone.name)) continue;
    drone.lease = checks::LeaseInputs{.drone = drone.name, .control = Control{}};
    drone.lease->control->mutable_holder();  // we, under any name
  }
}

bool Preflight::acquires(const std::string& name) const {
  return std::none_of(inputs_.drones.begin(), inputs_.drones.end(), [&](const DroneInputs& drone) {
    return drone.name == name && drone.lease && is_delegated(*drone.lease);
  });
}

bool Preflight::is_held(const std::string& name) const {
  return std::any_of(inputs_.drones.begin(), inputs_.drones.end(), [&](const DroneInputs& drone) {
    return drone.name == name && drone.lease && drone.lease->control && drone.lease->control->has_holder();
  });
}

Status Preflight::ready() const { return check(assess(inputs_)); }

bool Preflight::can_become_ready() const {
  return std::ranges::none_of(assess(inputs_),
                              [](const auto& one) { return one.problem == checks::Problem::battery_low; });
}

std::string Preflight::list() const {
  PreflightInputs inputs = inputs_;
  inputs.path = check_path(options_, inputs_);
  return "Before take-off:\n" + words(assess(inputs));
}

Status Preflight::path_fits() const { return check_path(options_, inputs_); }

Status Preflight::leases_fit() const {
  checks::Findings findings = assess(inputs_);
  // Who is stopped can be acquired, and link waits for the end of the stop.
  std::erase_if(findings,
                [](const auto& one) { return one.check != "lease" || one.problem == checks::Problem::stopped; });
  return check(findings);
}

}  // namespace ledgerline::launcher
