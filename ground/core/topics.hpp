#pragma once
#include <array>
#include <string>
#include <string_view>

#include "ground/core/flight.hpp"

namespace ledgerline::ground {

/// What ground publishes for ROS 2: a row a topic. docs/ros2.md has frames and meanings.
struct DroneTopic {
  std::string_view name;  ///< "/odom" of "/tello1/odom"
  bool of_all = false;    ///< one topic of this name for all drones
  std::string_view type;
  bool latched = false;  ///< who comes late still gets the last ones
  /// Its message as CDR; empty where the news have none. An error: what the ledger has is no such message.
  Result<std::string> (*make)(const DroneUpdate& news, const std::string& drone);
};
extern const std::array<DroneTopic, 7> drone_topics;
std::string topic_of(const DroneTopic& topic, const std::string& drone);

/// What ground hears from ROS 2, in the names of the Tello's driver for ROS 2, and stop.
struct PilotTopic {
  std::string_view name;  ///< behind "/<drone>"
  std::string_view type;
  bool reliable = true;  ///< best effort hears both kinds of writers; for what is soon said again
  bool cuts = false;     ///< motors off, in the air, too
  /// Adds the message to what the pilot commands. `came_ns`: the ground's clock.
  void (*take)(std::string_view cdr, TimeNs came_ns, PilotCommand& command);
};
extern const std::array<PilotTopic, 5> pilot_topics;
std::string topic_of(const PilotTopic& topic, const std::string& drone);

}  // namespace ledgerline::ground
