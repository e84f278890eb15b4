#pragma once
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/dds/dds.hpp"
#include "common/program/program.hpp"
#include "common/rt/spsc_ring.hpp"
#include "onboard/agent/core/mocap.hpp"
#include "onboard/agent/shell/ledger_follower.hpp"
#include "onboard/agent/shell/report.hpp"
#include "onboard/agent/shell/settings.hpp"
#include "onboard/ipc/ipc.hpp"

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
  void receive(const std::function<void(DroneNumber, const MocapPose&)>& on_pose);
  MocapClock& clock() { return intake_.clock(); }
  void count(ShellCounters& counters) const;

 private:
  struct Input {
    DroneNumber drone = 0;
    std::unique_ptr<SpscRing<MocapMessage, 64>> ring;
    std::optional<dds::RawReader> reader;
  };

  const Settings& settings_;
  const std::string label_;
  const std::function<void()> wake_;
  MocapIntake intake_;
  std::uint64_t implausible_ = 0;
  std::atomic<std::uint64_t> lost_{0};
  dds::ParticipantPtr participant_;
  std::vector<Input> inputs_;              ///< last: their threads use the above
  std::optional<dds::Discovery> unheard_;  ///< of the topics that are read
};

/// The I/O around the AgentCore of one channel. Agent's main loop owns all of them and the iceoryx end; the ledger
/// client's threads hand over through the mailbox, whose descriptor wakes the loop at once; DDS wakes it, too. All
/// methods but the constructor's and reach() are the loop's.
class AgentShell {
 public:
  struct Parts {
    Settings settings;
    bool several;  ///< there are further channels, so what is said names this one
    std::unique_ptr<crypto::MspRegistry> registry;
    std::unique_ptr<fabric::Client> client;   ///< for states and blocks
    std::unique_ptr<fabric::Client> urgent;   ///< for what must not wait behind states
    std::unique_ptr<fabric::Client> witness;  ///< asks a peer of another organisation; null: nobody is asked
    dds::ParticipantPtr participant;          ///< for mocap
    fabric::StoredCheckpoint kept;
  };
  explicit AgentShell(Parts parts);
  ~AgentShell() { mailbox_.close(); }
  AgentShell(const AgentShell&) = delete;
  AgentShell& operator=(const AgentShell&) = delete;

  /// Mocap, and the block stream's beginning; does not wait. `end` and `recorder` must outlive this.
  Status start(ipc::AgentEnd& end, Recorder& recorder);
  /// As LedgerFollower's. Behind one that fails what it waited for is taken when it comes. Any one thread; nothing else
  /// is called meanwhile.
  Status reach(const std::atomic<bool>& quit) { return ledger_.reach(quit, log_); }

  const std::string& channel() const { return settings_.core.check.where.channel; }
  bool flies(DroneNumber drone) const;
  /// Readable when turn() has something to take.
  int wake_fd() const { return mailbox_.wake_fd(); }
  TimeNs due_ns() const { return core_.due_ns(); }
  /// What came of the ledger and of mocap. `link_woke`: link's word began this turn. An error ends the agent; there is
  /// none where there are several channels.
  Status handle_events(bool link_woke);
  /// Of a drone that flies() here.
  void on_state(const StateSample& sample);
  void on_transition(const Transition& transition) { core_.on_transition(transition); }
  /// Behind all that was taken.
  void finish_turn();
  void write_status(TimeNs now, std::optional<std::int64_t> certificate_days) const;
  /// For an orderly end: until nothing is in flight, handle_events() and finish_turn() continue.
  void stop_submitting() { core_.stop_submitting(); }
  bool has_calls_in_flight() const { return core_.has_calls_in_flight(); }
  /// JSON; the checkpoint is kept, too.
  std::string end();

 private:
  void step_and_act();
  void run_periodic_tasks(TimeNs now);

  const Settings settings_;
  const std::unique_ptr<crypto::MspRegistry> registry_;
  AgentCore core_;
  AgentOutputs out_;
  AgentLog log_;
  ipc::AgentEnd* end_ = nullptr;  ///< from start() on, as the next
  Recorder* recorder_ = nullptr;
  std::uint32_t heartbeat_for_ = AgentHeartbeat::all_drones;
  ShellCounters counters_;
  TimeNs next_clock_ns_ = 0, next_checkpoint_ns_ = 0;
  bool link_woke_ = false;  ///< in this turn

  // In this order: the threads and streams below use what is above, and are ended first.
  Mailbox mailbox_;
  MocapInput mocap_;
  std::unique_ptr<fabric::Client> client_, urgent_;
  LedgerFollower ledger_;
};

}  // namespace ledgerline::agent
