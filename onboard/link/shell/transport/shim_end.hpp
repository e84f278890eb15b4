#pragma once
#include <array>
#include <vector>

#include "onboard/ipc/ipc.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/shell/transport/link_ends.hpp"
#include "onboard/shim/mapping.hpp"

namespace ledgerline::link {

/// Drones that are reached through the shim's memory, by their numbers. No system call.
class ShimTransport final : public Transport {
 public:
  /// Data of a drone that is not in `drones` is ignored.
  ShimTransport(drone_shim::Memory& memory, const std::vector<DroneSettings>& drones);
  std::span<const Received> receive() noexcept override;
  bool send(const ToSend& message) noexcept override;
  std::vector<std::string> refresh() override { return {}; }

 private:
  static constexpr std::size_t max_received = 64;
  drone_shim::Memory& memory_;
  DroneSet drones_;
  std::array<drone_shim::Datagram, max_received> datagrams_;
  std::array<Received, max_received> received_{};
};

/// The clock that the shim's other end moves. It waits on a futex; after each 0.2 s it checks that the other end lives.
class LockstepClock final : public LoopClock {
 public:
  explicit LockstepClock(const drone_shim::Mapping& mapping) noexcept
      : mapping_(mapping), turns_(mapping.memory().turns) {}
  /// The turn that it is in is over with it, too.
  ~LockstepClock() override { end_turn(); }
  TimeNs wait(const std::atomic<bool>& stopping) noexcept override;
  TimeNs due_ns() const noexcept override { return now_ns_; }
  TimeNs now() const noexcept override { return now_ns_; }
  /// The other end's clock is no host's.
  TimeNs suspended_ns() const noexcept override { return 0; }
  bool is_lost() const noexcept override { return lost_; }
  std::uint64_t overruns() const noexcept override { return 0; }
  const Histogram& late() const noexcept override { return late_; }

 private:
  void end_turn() noexcept;

  const drone_shim::Mapping& mapping_;
  drone_shim::Memory::Turns& turns_;
  TimeNs now_ns_ = 0;
  bool in_turn_ = false, lost_ = false;
  Histogram late_;  ///< empty: on this clock nothing is late
};

/// Lockstep: the shim's other end in agent's place. No lock, no system call.
class LockstepAgent final : public ipc::LinkEnd {
 public:
  explicit LockstepAgent(drone_shim::Memory& memory) noexcept : memory_(memory) {}
  bool receive_plan(Plan& out) noexcept override { return memory_.plans.pop(out); }
  bool receive_pose(Pose& out) noexcept override { return memory_.poses.pop(out); }
  bool receive_heartbeat(AgentHeartbeat& out) noexcept override { return memory_.heartbeats.pop(out); }
  bool send_state(const StateSample& sample) noexcept override { return memory_.states.push(sample); }
  bool send_transition(const Transition& transition) noexcept override { return memory_.transitions.push(transition); }
  /// It looks after every turn.
  void wake_agent() noexcept override {}

 private:
  drone_shim::Memory& memory_;
};

}  // namespace ledgerline::link
