#include "tools/launcher/preflight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/text.hpp"
#include "common/msg/proto_json.hpp"
#include "sim/core/parameters.hpp"
#include "tools/launcher/configs.hpp"

namespace ledgerline::launcher {
namespace {

using checks::DroneInputs;
using checks::FlightInputs;
using nlohmann::json;

std::string text_in(const json& object, const char* key, const std::string& otherwise) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : otherwise;
}

void read_drone(const json& one, DroneInputs& drone) {
  const std::string phase = text_in(one, "phase", "disconnected");
  drone.there = phase != "disconnected";
  drone.phase = phase == "on_ground" || phase == "landed" ? "" : phase;
  drone.refusal = text_in(one, "cause", "unknown");
  if (drone.refusal == "none") drone.refusal.clear();
  const auto battery = one.find("battery");
  if (battery != one.end() && battery->is_number()) drone.battery = battery->get<double>();
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

FlightInputs inputs_of(const Options& options) {
  FlightInputs inputs;
  if (!options.own) return inputs;
  const deployment::OwnDrones& own = *options.own;
  for (const deployment::OwnDrone& one : own.drones) {
    DroneInputs drone{.name = one.name, .address = one.address, .interface = one.interface};
    drone.wanted_serial = one.serial;
    inputs.drones.push_back(std::move(drone));
  }
  inputs.link = own.link;
  inputs.pose_source = own.pose_source;
  inputs.pose_topic = own.pose_topic;
  inputs.stamps_count = own.pose_stamps_count;
  inputs.enrols = !own.network || !own.network->admin.empty();
  inputs.ledger.what = own.network ? "a network of others" : deployment::name_of(own.ledger);
  return inputs;
}

Status check_path(const Options& options, const FlightInputs& inputs) {
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

Status read_records(const std::string& line, const crypto::IdentityName& self, FlightInputs& inputs) {
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

Status Preflight::ready() const { return check(assess(inputs_)); }

std::string Preflight::list() const {
  FlightInputs inputs = inputs_;
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
