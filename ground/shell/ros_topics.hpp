#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/dds/dds.hpp"
#include "common/dds/raw.hpp"
#include "ground/core/flight_types.hpp"
#include "ground/shell/settings.hpp"

namespace ledgerline::ground {

/// The drones' ROS 2 topics: what the ledger says of them is published, and pilots' topics are read, those that the
/// settings let in. DDS knows no users: any process that can write one of these is a pilot, without token or session.
/// Drones are known by their index in `drones`. The flight's thread.
class RosTopics {
 public:
  RosTopics(dds::ParticipantPtr participant, std::vector<std::string> drones)
      : participant_(std::move(participant)), drones_(std::move(drones)), unpublished_(drones_.size()) {}

  Status open_writers();
  void publish(const DroneUpdate& update);

  /// A message of that drone's topic; on a thread of DDS.
  using OnMessage = std::function<void(std::size_t drone, const PilotTopic& topic, std::string_view cdr)>;
  /// Somebody writes one of that drone's topics and is not heard: dds::report_unheard(); on a thread of DDS.
  using OnUnheard = std::function<void(std::size_t drone, const std::string& why)>;
  Status read_pilots(const PilotSettings& settings, const OnMessage& on_message, const OnUnheard& on_unheard);

  /// Why somebody who writes a drone's topics is not heard, by drone; empty: all of all drones are. Any thread.
  std::vector<std::string> unheard() const;
  /// Messages of that drone's pilot that DDS did not hand over.
  ShellCounters::Pilot losses(std::size_t drone) const;
  /// What the ledger had of that drone, but was no such message, or DDS did not take.
  std::uint64_t unpublished(std::size_t drone) const { return unpublished_[drone]; }

 private:
  struct Reader {
    std::size_t drone;
    dds::RawReader reader;
  };
  const dds::ParticipantPtr participant_;
  const std::vector<std::string> drones_;             ///< names
  std::vector<std::vector<dds::RawWriter>> writers_;  ///< a row for each of drone_topics, a drone each
  std::vector<Reader> readers_;
  std::vector<std::size_t> drone_of_topic_;  ///< of each topic of pilots, read or not
  std::vector<std::uint64_t> unpublished_;   ///< of each drone
  TimeNs next_warning_ns_ = 0;
  mutable std::mutex unheard_mutex_;
  std::map<std::size_t, std::string> unheard_why_;  ///< by index into drone_of_topic_
  std::optional<dds::Discovery> discovery_;         ///< of pilots' topics
};

}  // namespace ledgerline::ground
