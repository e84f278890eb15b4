#pragma once
#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/belief/control_records.hpp"
#include "common/dds/dds.hpp"
#include "common/fabric/checkpoint/keeper.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/fabric/renewal/certificate_watch.hpp"
#include "common/fabric/stream/confirmations.hpp"
#include "common/program/recorder.hpp"
#include "common/program/service_manager.hpp"
#include "common/rt/spsc_ring.hpp"
#include "onboard/agent/core/agent_core.hpp"
#include "onboard/agent/core/mocap_intake.hpp"
#include "onboard/agent/core/records/second_opinion.hpp"
#include "onboard/agent/shell/letters.hpp"
#include "onboard/agent/shell/report.hpp"
#include "onboard/agent/shell/settings.hpp"
#include "onboard/ipc/ipc.hpp"

namespace ledgerline::agent {

/// Real time minus CLOCK_MONOTONIC, now.
TimeNs real_offset();

/// The agent's I/O around AgentCore. One main loop owns the core and the iceoryx end; the ledger client's threads hand
/// over through the mailbox, whose descriptor wakes the loop at once; DDS hands over through one wait-free ring per
/// drone, and wakes it, too; so does link, behind each state. The loop waits for those and for the moment at which a
/// frame or beat is due; it has no period.
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

  /// RouDi, mocap, the block stream, the control records: each with a bounded wait and a message that names the cure.
  Status start();
  /// Until `quit`, or until RouDi is gone and link, too, or on the ground; then waits a moment for what is under way,
  /// and writes the summary.
  Status run();
  /// Has renewed certificates taken while it runs. Before start().
  void watch_certificates(std::unique_ptr<fabric::CertificateWatch> watch) { certificates_ = std::move(watch); }

 private:
  struct Mocap {
    DroneNumber drone = 0;
    std::unique_ptr<SpscRing<MocapMessage, 64>> ring;
    std::optional<dds::RawReader> subscriber;
  };

  Status keep_waiting(const std::string& what, const std::function<Status()>& attempt) const;
  Status subscribe_to_mocap();
  void hurry(const char* thread) const;
  void open_checkpoint();
  void open_block_stream();
  Status wait_for_block_stream();
  Status take_early_letters();
  void take_continued(const fabric::Continuation& how);
  void keep_checkpoint();
  void read_records_again(const std::stop_token& stop);
  Result<FirstRecords> read_records(const belief::Evaluate& evaluate) const;
  Result<FirstRecords> read_records();
  void ask_witness(const std::stop_token& stop);
  void take_second_reading(const SecondReading& reading);
  Status confirm(const FirstRecords& records) const;
  void set_records(const FirstRecords& records);
  void watch_roudi(const std::stop_token& stop);
  bool cut_off(TimeNs now) const;

  void wait();
  Status take_letters();
  Status take_block(fabric::Block block);
  Status take_records(const RecordsRead& read);
  void take_states();
  void take_mocap();
  void tell_implausible(DroneNumber drone, const MocapMessage& message);
  void step_and_act();
  void tell_refusals();
  void tell_evictions();
  void tell_unconfirmed_stops();
  void tell_doubts();
  void tell_outcome(const fabric::Outcome& outcome);
  void tell_connection(const StreamState& state);
  void tell_lost_transitions();
  void chores(TimeNs now);
  void drain();
  Status write_summary();

  Settings settings_;
  const std::atomic<bool>& quit_;
  std::unique_ptr<crypto::MspRegistry> registry_;
  AgentCore core_;
  AgentOutputs out_;
  std::unique_ptr<ipc::AgentEnd> end_;
  Recorder recorder_;
  ShellCounters counters_;
  std::optional<ServiceManager> manager_;
  std::uint64_t turns_ = 0;  ///< of run()
  std::atomic<std::uint64_t> mocap_lost_{0};
  std::atomic<bool> roudi_gone_{false};
  TimeNs flight_heard_ns_ = 0;  ///< newest state of a drone in the air
  MocapIntake mocap_intake_{real_offset, settings_.mocap_stamps_are_of_this_host};
  TimeNs next_clock_ns_ = 0, next_status_ns_ = 0, next_refusal_log_ns_ = 0, next_outcome_log_ns_ = 0,
         next_unheard_log_ns_ = 0, next_checkpoint_ns_ = 0;
  std::uint64_t transitions_lost_ = 0;  ///< as told last
  bool connected_ = false, mocap_warned_ = false;
  bool link_woke_ = false;  ///< in this turn
  std::string stream_problem_;
  belief::ControlStart control_start_;
  std::vector<std::string> names_;                ///< of the drones
  std::optional<fabric::Checkpoint> checkpoint_;  ///< as the last agent left it
  std::optional<FirstRecords> kept_records_;      ///< of it, where it has one of each drone
  std::uint64_t catch_up_to_ = 0;                 ///< height that the chain had at the start
  bool gap_ = false;                              ///< between it and the start: blocks were not read
  std::optional<Confirmed> confirmed_;            ///< the newest block that the own peer has told
  std::optional<std::uint64_t> kept_;             ///< its number in the newest checkpoint
  std::unique_ptr<fabric::CheckpointKeeper> keeper_;
  SecondOpinion second_opinion_;
  std::string witness_problem_;         ///< as told last
  std::atomic<bool> ask_again_{false};  ///< the witness, soon

  // In this order: the threads and streams below use what is above, and are ended first.
  Mailbox mailbox_;
  dds::ParticipantPtr participant_;
  std::vector<Mocap> mocap_;
  std::unique_ptr<fabric::Client> client_, urgent_, witness_;
  fabric::Confirmations confirmations_;
  std::unique_ptr<fabric::Client::Stream> blocks_;
  std::jthread control_reader_, roudi_watch_, witness_reader_;
  std::unique_ptr<fabric::CertificateWatch> certificates_;
};

}  // namespace ledgerline::agent
