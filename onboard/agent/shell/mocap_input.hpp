#pragma once
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/dds/dds.hpp"
#include "common/rt/spsc_ring.hpp"
#include "onboard/agent/core/mocap.hpp"
#include "onboard/agent/shell/report.hpp"
#include "onboard/agent/shell/settings.hpp"

namespace ledgerline::agent {

/// The poses of a motion capture system, of one channel's drones, and the clock that they are stamped by. DDS's threads
/// hand over through one wait-free ring per drone, and wake the loop, whose are all methods.
class MocapInput {
 public:
  /// `settings` must outlive it; `wake`: any thread.
  MocapInput(const Settings& settings, std::string label, dds::ParticipantPtr participant, std::function<void()> wake);

  /// Subscribes to the topics, where some are configured.
  Status open();
  /// Hands over the poses that have come and are accepted; of the first that is not the log has a word.
  void take(const std::function<void(DroneNumber, const MocapPose&)>& on_pose);
  MocapClock& clock() { return intake_.clock(); }
  void count(ShellCounters& counters) const;

 private:
  struct Input {
    DroneNumber drone = 0;
    std::unique_ptr<SpscRing<MocapMessage, 64>> ring;
    std::optional<dds::RawReader> reader;
  };
  void report_implausible(DroneNumber drone, const MocapMessage& message);

  const Settings& settings_;
  const std::string label_;
  const std::function<void()> wake_;
  MocapIntake intake_;
  std::uint64_t implausible_ = 0;
  std::atomic<std::uint64_t> lost_{0};
  dds::ParticipantPtr participant_;
  std::vector<Input> inputs_;  ///< last: their threads use the above
};

}  // namespace ledgerline::agent
