#pragma once
#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/dds/dds.hpp"
#include "common/fabric/checkpoint/keeper.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/fabric/stream/confirmations.hpp"
#include "common/program/recorder.hpp"
#include "common/rt/spsc_ring.hpp"
#include "common/verification/control_records.hpp"
#include "onboard/agent/core/agent_core.hpp"
#include "onboard/agent/core/mocap_intake.hpp"
#include "onboard/agent/core/records/second_opinion.hpp"
#include "onboard/agent/shell/events.hpp"
#include "onboard/agent/shell/report.hpp"
#include "onboard/agent/shell/settings.hpp"
#include "onboard/ipc/ipc.hpp"

namespace ledgerline::agent {

/// Real time minus CLOCK_MONOTONIC, now.
TimeNs real_offset();

/// Whether `now` is at or beyond `next`, which then moves on.
bool due(TimeNs now, TimeNs& next, TimeNs period_ns);

/// For the calling thread: a block's way to link is the stream's thread, then the main loop. Priority 0: as it is.
void raise_priority(int priority, const char* thread);

/// The I/O around the AgentCore of one channel. Agent's main loop owns all of them and the iceoryx end; the ledger
/// client's threads hand over through the mailbox, whose descriptor wakes the loop at once; DDS hands over through one
/// wait-free ring per drone, and wakes it, too. All methods but the constructor's and reach() are the loop's.
class AgentShell {
 public:
  /// `quit` is watched everywhere and must outlive the shell.
  /// `client` is for states and blocks, `urgent` for what must not wait behind states, `witness` asks a peer of another
  /// organisation (none: nobody is asked).
  /// `participant`: for mocap. `checkpoint`: as the file of the settings has it; none: there is none yet.
  AgentShell(Settings settings, std::unique_ptr<crypto::MspRegistry> registry, std::unique_ptr<fabric::Client> client,
             std::unique_ptr<fabric::Client> urgent, std::unique_ptr<fabric::Client> witness,
             dds::ParticipantPtr participant, std::optional<fabric::Checkpoint> checkpoint,
             const std::atomic<bool>& quit);
  ~AgentShell();

  /// Mocap, and the block stream's beginning; does not wait. `end` and `recorder` must outlive this; `several`: there
  /// are further channels, so what is said names this one.
  Status start(ipc::AgentEnd& end, Recorder& recorder, bool several);
  /// Waits for the block stream and the control records, each for a bounded time, with a message that names the cure.
  /// Behind one that fails what it waited for is taken when it comes. Any one thread; nothing else is called meanwhile.
  Status reach();

  const std::string& channel() const { return settings_.core.check.where.channel; }
  bool flies(DroneNumber drone) const;
  /// Readable when turn() has something to take.
  int wake_fd() const { return mailbox_.wake_fd(); }
  TimeNs due_ns() const { return core_.due_ns(); }
  /// What came of the ledger and of mocap. `link_woke`: link's word began this turn. An error ends the agent; there is
  /// none where there are several channels.
  Status take_inputs(bool link_woke);
  /// Of a drone that flies() here.
  void take_state(const StateSample& sample);
  void take_transition(const Transition& transition) { core_.on_transition(transition); }
  /// Behind all that was taken.
  void finish_turn();
  void write_status(TimeNs now, std::optional<std::int64_t> certificate_days) const;
  /// For an orderly end: until nothing is in flight, take_inputs() and finish_turn() continue.
  void stop_submitting() { core_.stop_submitting(); }
  bool anything_under_way() const { return core_.anything_under_way(); }
  /// JSON; the checkpoint is kept, too.
  std::string end();
  /// What comes from now on is thrown away, and nobody waits to bring it.
  void close() { mailbox_.close(); }

 private:
  struct Mocap {
    DroneNumber drone = 0;
    std::unique_ptr<SpscRing<MocapMessage, 64>> ring;
    std::optional<dds::RawReader> subscriber;
  };

  Status keep_waiting(const std::string& what, const std::function<Status()>& attempt) const;
  Status subscribe_to_mocap();
  void open_checkpoint();
  void open_block_stream();
  Status wait_for_block_stream();
  Status take_early_events();
  void take_continued(const fabric::Continuation& how);
  void keep_checkpoint();
  void read_records_again(const std::stop_token& stop);
  Result<FirstRecords> read_records(const verification::Evaluate& evaluate) const;
  Result<FirstRecords> read_records();
  void ask_witness(const std::stop_token& stop);
  void take_second_reading(const SecondReading& reading);
  /// Of an organisation that a drone has just been granted to.
  void read_roles(const std::stop_token& stop, const verification::Organisations& organisations);
  void take_roles(const RolesRead& read);
  void tell_left_out();
  void tell_by_flag();
  Status confirm(const FirstRecords& records);
  void set_records(const FirstRecords& records);

  Status take_events();
  Status take_block(fabric::Block block);
  Status take_records(const RecordsRead& read);
  void take_mocap();
  void tell_implausible(DroneNumber drone, const MocapMessage& message);
  void step_and_act();
  void tell_refusals();
  void tell_evictions();
  void tell_unconfirmed_stops();
  void log_violations();
  void tell_outcome(const fabric::Outcome& outcome);

  void tell_lost_transitions();
  void run_periodic_tasks(TimeNs now);

  Settings settings_;
  const std::atomic<bool>& quit_;
  std::unique_ptr<crypto::MspRegistry> registry_;
  AgentCore core_;
  AgentOutputs out_;
  ipc::AgentEnd* end_ = nullptr;  ///< from start() on, as the next
  Recorder* recorder_ = nullptr;
  bool several_ = false;  ///< there are further channels
  std::string label_;     ///< begins what is said; empty: there is one channel
  std::function<void(bool connected, const std::string& why)> tell_connection_;
  std::uint32_t heartbeat_for_ = AgentHeartbeat::all_drones;
  ShellCounters counters_;
  std::atomic<std::uint64_t> mocap_lost_{0};
  MocapIntake mocap_intake_{real_offset, settings_.mocap_stamps_are_of_this_host};
  TimeNs next_clock_ns_ = 0, next_refusal_log_ns_ = 0, next_outcome_log_ns_ = 0, next_unheard_log_ns_ = 0,
         next_checkpoint_ns_ = 0;
  std::uint64_t transitions_lost_ = 0;  ///< as reported last
  bool connected_ = false, mocap_warned_ = false;
  bool link_woke_ = false;  ///< in this turn
  std::string stream_problem_;
  verification::ControlStart control_start_;
  std::vector<std::string> names_;                ///< of the drones
  std::optional<fabric::Checkpoint> checkpoint_;  ///< as the last agent left it
  std::optional<FirstRecords> kept_records_;      ///< of it, where it has one of each drone
  std::uint64_t catch_up_to_ = 0;                 ///< height that the chain had at the start
  /// Blocks between it and the start were not read, and nobody has reported the same records as the own peer yet.
  std::atomic<bool> unconfirmed_{false};
  std::optional<Confirmed> confirmed_;  ///< the newest block that the own peer has delivered
  std::optional<std::uint64_t> kept_;   ///< its number in the newest checkpoint
  std::unique_ptr<fabric::CheckpointKeeper> keeper_;
  SecondOpinion second_opinion_;
  std::string witness_problem_;         ///< as reported last
  verification::Organisations unread_;  ///< whose roles are to be read, once no such reading is in progress
  std::size_t left_out_reported_ = 0;   ///< organisations whose roles are left out, as reported last
  std::atomic<bool> ask_again_{false};  ///< the witness, soon

  // In this order: the threads and streams below use what is above, and are ended first.
  Mailbox mailbox_;
  dds::ParticipantPtr participant_;
  std::vector<Mocap> mocap_;
  std::unique_ptr<fabric::Client> client_, urgent_, witness_;
  fabric::Confirmations confirmations_;
  std::unique_ptr<fabric::Client::Stream> blocks_;
  std::optional<std::jthread> role_reader_;  ///< one at a time
  std::jthread control_reader_, witness_reader_;
};

}  // namespace ledgerline::agent
