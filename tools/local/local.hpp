#pragma once
#include <atomic>
#include <memory>
#include <optional>
#include <vector>

#include "common/dds/dds.hpp"
#include "common/dds/raw.hpp"
#include "common/program/program.hpp"
#include "common/rt/spsc_ring.hpp"
#include "ground/shell/settings.hpp"
#include "onboard/agent/core/mocap.hpp"
#include "onboard/ipc/ipc.hpp"

namespace ledgerline::local {

/// Ground's controller beside the driver: states from link and plans to link through shared memory, mocap from DDS, no
/// ledger. The reference that flights through a ledger are compared with; not for real drones: nobody signs, and nobody
/// but this process can stop them. One thread runs the core; DDS hands over through one wait-free ring a drone.
class LocalShell {
 public:
  LocalShell(ground::FlightConfig flight, ground::OutputSettings output, dds::ParticipantPtr participant,
             const std::atomic<bool>& quit);

  /// RouDi (waited for, 15 s at most), shared memory, mocap, trace.
  Status start();
  /// Until every drone has landed or failed; once `quit` is set all land. True: every one finished its path.
  Result<bool> run();

 private:
  struct Drone {
    DroneNumber number = 0;
    agent::Fusion fusion{agent::FusionSettings{}};
    std::unique_ptr<SpscRing<agent::MocapMessage, 64>> ring;
    std::optional<dds::RawReader> reader;
  };

  Status subscribe_mocap();
  void forward_mocap();
  void receive_states(std::vector<StateSample>& states);
  void send_heartbeat(TimeNs now_ns);
  void step(const ground::FlightInputs& inputs);

  ground::OutputSettings output_;
  ground::FlightCore core_;
  dds::ParticipantPtr participant_;
  const std::atomic<bool>& quit_;
  std::unique_ptr<ipc::AgentEnd> end_;
  Recorder recorder_;
  AgentHeartbeat heartbeat_;
  TimeNs next_heartbeat_ns_ = 0, next_status_ns_ = 0;
  std::uint64_t plans_lost_ = 0, poses_implausible_ = 0;
  agent::MocapIntake mocap_intake_{[] { return realtime_ns() - monotonic_ns(); }};
  std::vector<Drone> drones_;  ///< last: their readers end first
};

}  // namespace ledgerline::local
