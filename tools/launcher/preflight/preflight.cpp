#include "tools/launcher/preflight/preflight.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tools/launcher/preflight/fence.hpp"

namespace ledgerline::fly {
namespace {

using nlohmann::json;

std::string text_in(const json& object, const char* key, const std::string& otherwise) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : otherwise;
}

double number_in(const json& object, const char* key, double otherwise) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : otherwise;
}

}  // namespace

Preflight::Preflight(const Options& options)
    : options_(options), drones_(options.own ? options.own->drones.size() : 0) {}

void Preflight::take(const std::string& line) {
  const json message = json::parse(line, nullptr, false);
  const json link = message.is_object() ? message.value("link", json()) : json();
  const json list = link.is_object() ? link.value("drones", json()) : json();
  for (const json& one : list.is_array() ? list : json::array()) {
    if (!one.is_object()) continue;
    for (std::size_t i = 0; i < drones_.size(); ++i) {
      if (text_in(one, "name", "") != own(i).name) continue;
      Drone& drone = drones_[i];
      drone.phase = text_in(one, "phase", drone.phase);
      drone.cause = text_in(one, "cause", drone.cause);
      drone.battery = number_in(one, "battery", drone.battery);
      drone.pose_age_ms = number_in(one, "pose_age_ms", -1);
      const auto position = one.find("position");
      if (position == one.end() || !position->is_array() || position->size() != 3) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        if ((*position)[k].is_number()) drone.position_m[k] = (*position)[k].get<double>();
      }
    }
  }
}

bool Preflight::ready(const Drone& drone) const {
  const bool lacks_only_pose = drone.cause == "pose_lost" && pose_of(options_) == "none";
  return (drone.phase == "on_ground" || drone.phase == "landed") && (drone.cause == "none" || lacks_only_pose);
}

bool Preflight::ready() const {
  return std::all_of(drones_.begin(), drones_.end(), [this](const Drone& drone) { return ready(drone); });
}

std::string Preflight::list() const {
  std::string text = "Before take-off:\n";
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    const Drone& drone = drones_[i];
    const std::string behind = own(i).interface.empty() ? "" : " behind " + own(i).interface;
    text += fmt::format("  {:<10} {:<15}{}  ", own(i).name, own(i).address, behind);
    if (!drone.there()) {
      text += "not there\n";
      continue;
    }
    text += fmt::format("battery {:.0f} %  ", 100 * drone.battery);
    if (pose_of(options_) == "none") {
      text += "by hand, without a pose\n";
      continue;
    }
    text += fmt::format("pose from {}", pose_of(options_));
    text += drone.pose_age_ms < 0 ? ": none\n"
                                  : fmt::format(", {:.0f} ms old: {:.2f}, {:.2f}, {:.2f} m\n", drone.pose_age_ms,
                                                drone.position_m[0], drone.position_m[1], drone.position_m[2]);
  }
  const link::FenceSettings& fence = options_.own->link.fence;
  text += fmt::format("  fence      x {:g} to {:g}, y {:g} to {:g}, z {:g} to {:g} m", fence.min_m[0], fence.max_m[0],
                      fence.min_m[1], fence.max_m[1], fence.min_m[2], fence.max_m[2]);
  if (pose_of(options_) == "none") text += ": of these the ceiling alone holds";
  return text;
}

std::string Preflight::why_not(std::size_t i) const {
  const Drone& drone = drones_[i];
  if (!drone.there()) return "does not answer: is it on, and does this computer reach it?";
  if (drone.cause == "pose_lost" && drone.pose_age_ms < 0)
    return fmt::format("no pose of it has come from {}", pose_of(options_));
  if (drone.cause == "pose_lost")
    return fmt::format("its pose from {} is {:.0f} ms old", pose_of(options_), drone.pose_age_ms);
  if (drone.cause == "battery_low") return fmt::format("its battery has {:.0f} %", 100 * drone.battery);
  if (!drone.cause.empty() && drone.cause != "none") return drone.cause;
  return "it is not on the ground: " + drone.phase;
}

std::string Preflight::missing() const {
  std::vector<std::string> all;
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    if (!ready(drones_[i])) all.push_back(fmt::format("{} at {}: {}", own(i).name, own(i).address, why_not(i)));
  }
  return fmt::format("{}", fmt::join(all, "; "));
}

Status Preflight::path_fits() const {
  if (options_.manual || !options_.own) return done;
  std::vector<Eigen::Vector2d> starts;
  for (const Drone& drone : drones_) starts.emplace_back(drone.position_m[0], drone.position_m[1]);
  const std::string beyond = beyond_fence(options_, options_.own->link.fence, starts);
  if (!beyond.empty()) return Error{beyond};
  return done;
}

}  // namespace ledgerline::fly
