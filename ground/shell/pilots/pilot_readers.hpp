#pragma once
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/dds/dds.hpp"
#include "common/dds/raw.hpp"
#include "ground/core/topics.hpp"
#include "ground/shell/settings.hpp"

namespace ledgerline::ground {

/// The readers of pilots' topics, of those that the settings let in. DDS knows no users: any process that can write one
/// of these topics is a pilot, without token or session. create() and the end: ground's thread.
class PilotReaders {
 public:
  /// A message of that drone's topic; on a thread of DDS.
  using OnMessage = std::function<void(std::size_t drone, const PilotTopic& topic, std::string_view cdr)>;

  static Result<PilotReaders> create(const dds::ParticipantPtr& participant, const std::vector<std::string>& drones,
                                     const PilotSettings& settings, const OnMessage& on_message);

  /// Messages of that drone's pilot that DDS did not hand over.
  ShellCounters::Pilot losses(std::size_t drone) const;

 private:
  struct OfDrone {
    std::size_t drone;
    dds::RawReader reader;
  };
  std::vector<OfDrone> readers_;
};

}  // namespace ledgerline::ground
