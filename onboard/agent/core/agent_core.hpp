#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/check.hpp"
#include "common/fabric/client/outcome.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/rt/histogram.hpp"
#include "common/rt/trace.hpp"
#include "onboard/agent/core/command_check.hpp"
#include "onboard/agent/core/fusion.hpp"
#include "onboard/agent/core/integrity_monitor.hpp"
#include "onboard/agent/core/outbox/alarm_sender.hpp"
#include "onboard/agent/core/outbox/batcher.hpp"
#include "onboard/agent/core/outbox/idle_evictor.hpp"
#include "onboard/agent/core/outbox/stop_applier.hpp"
#include "onboard/agent/core/outbox/transition_sender.hpp"

namespace ledgerline::agent {

struct AgentConfig {
  std::vector<DroneName> drones;
  BatchConfig batch;
  CheckConfig check;
  FusionConfig fusion;
  TimeNs heartbeat_period_ns = 50 * ns_per_ms;
  TimeNs first_heartbeat_wait_ns = 200 * ns_per_ms;  ///< for a pose of every drone, at most
  TimeNs ledger_silent_after_ns = 1 * ns_per_s;
  TimeNs idle_evict_ns = usual_idle_ns;  ///< 0: never, see IdleEvictor
  /// How long an integrity violation counts: longer than a stream's reconnect, and than the time between two
  /// comparisons with another organisation's records. Half: a lie that goes on would be trusted again and again.
  /// Double: drones stay on the ground for longer, where link asks for that.
  TimeNs integrity_hold_ns = 10 * ns_per_s;
  std::uint64_t seed = 1;  ///< of the back-off's jitter
};

/// What the agent wants done. Calls of AgentCore append; the shell acts on it and clears it.
struct AgentOutputs {
  struct Submit {
    std::uint64_t frame = 0;  ///< give it back to on_outcome()
    fabric::Call call;
    bool urgent = false;  ///< transitions, alarms, applied stops, evictions: must not wait behind states
  };
  std::vector<Submit> submits;
  std::vector<Plan> plans;  ///< to link
  std::vector<Pose> poses;  ///< to link
  std::optional<AgentHeartbeat> heartbeat;
  std::vector<TraceRecord> traces;
  /// For the log, of an eviction of an idle holder: how a call ended, or that one goes out.
  struct Eviction {
    std::string drone;
    std::optional<fabric::Repeat::Next> ended;  ///< none: it goes out
    std::string why;                            ///< it did not get onto the ledger
  };
  std::vector<Eviction> evictions;
  std::vector<CommandCheck::Checked::UnconfirmedStop> unconfirmed_stops;
  std::vector<IntegrityMonitor::Word> violations;  ///< for the log
  void clear();
};

/// One drone as the agent sees it, for status lines and summaries.
struct DroneReport {
  Batcher::Counters states;
  TransitionSender::Counters transitions;
  CommandCheck::Counters commands;
  Fusion::Counters mocap;
  std::optional<StateSample> newest;    ///< from link
  TimeNs last_command_verified_ns = 0;  ///< 0: none yet
  Histogram two_way;                    ///< verified - state stamp
};

/// The agent without its I/O: batches states into frames, checks commands from blocks, fuses mocap, sends heartbeats.
/// Inputs first, then step() with the same or a later time: frames, verified plans and the heartbeat come out of step()
/// alone, so that `verified_ns` is the time of handing over, checking included. Call step() after every burst of
/// inputs, when due_ns() says so, and at least every few milliseconds: what is sent again after a failure waits for no
/// less. `now` never goes back. One thread; deterministic: the same inputs give the same outputs.
class AgentCore {
 public:
  /// The registry must outlive the core.
  AgentCore(AgentConfig config, crypto::MspRegistry& registry);

  /// Real time minus the monotonic clock: for ROS headers and certificates alone.
  void set_real_offset(TimeNs offset_ns) { real_offset_ns_ = offset_ns; }
  /// Control records as read from the ledger (`get control/<drone>`), before the first block is given.
  void set_control(TimeNs now, const Control& control);
  void set_roles(verification::Roles roles);
  /// As CommandCheck's.
  verification::Organisations await_roles() { return check_.await_roles(); }
  void add_roles(const verification::Roles& read) { check_.add_roles(read); }
  const verification::Organisations& roles_left_out() const { return check_.roles_left_out(); }

  void on_state(TimeNs now, const StateSample& sample, AgentOutputs& out);
  void on_transition(const Transition& transition) { transitions_.add(transition); }
  void on_mocap(TimeNs now, DroneNumber drone, const MocapPose& measured, AgentOutputs& out);
  void on_outcome(TimeNs now, std::uint64_t frame, const fabric::Outcome& outcome, AgentOutputs& out);
  void on_block(TimeNs now, const fabric::Block& block, AgentOutputs& out);
  /// One that the stream refused: stops are taken from it, and nothing else.
  void on_refused_block(TimeNs now, const fabric::Block& block, AgentOutputs& out);
  void on_connection(TimeNs now, bool connected);  ///< of the block stream
  /// An integrity violation that was found outside, in words: by the stream, by another organisation's records.
  void on_violation(TimeNs now, IntegrityViolation kind, const std::string& words) {
    integrity_.add(now, kind, newest_block(), words);
  }
  /// Whether another organisation's peer tells other records now.
  void set_records_differ(bool differ) { integrity_.records_differ(differ); }
  void step(TimeNs now, AgentOutputs& out);
  /// Checks that failed in step(): the heartbeats say so from then on, and link lands the drones.
  const CheckLog& checks() const { return checks_; }
  /// After step(): when the next frame or heartbeat is due, if nothing comes before; INT64_MAX: none is.
  TimeNs due_ns() const;
  /// Writes integrity violations to the log now: step() does it, too, but not before there is a stream.
  void log_violations(TimeNs now, AgentOutputs& out);

  /// From now on step() makes no frame of states and evicts nobody; what is in flight may end, and transitions and
  /// apply_stops still go. For an orderly end.
  void stop_submitting() { submitting_ = false; }
  bool has_calls_in_flight() const {
    return batcher_.in_flight() > 0 || transitions_.pending() || stop_applier_.pending() || idle_.in_flight() ||
           alarms_.in_flight();
  }

  bool ledger_alive(TimeNs now) const;
  std::uint64_t height() const { return check_.height(); }
  FirstRecords records() const { return check_.records(); }
  std::uint64_t blocks() const { return blocks_; }
  const std::string& last_chain_error() const { return last_chain_error_; }
  std::uint64_t blocks_broken() const { return check_.broken_blocks(); }
  const Batcher::Transactions& transactions() const { return batcher_.transactions(); }
  const StopApplier& stop_applier() const { return stop_applier_; }
  const IntegrityMonitor& integrity() const { return integrity_; }
  fabric::ValidatedShare& validated_share() { return validated_share_; }
  const fabric::ValidatedShare& validated_share() const { return validated_share_; }
  const AlarmSender& alarms() const { return alarms_; }
  const IdleEvictor& idle() const { return idle_; }
  std::uint64_t unconfirmed_stops() const { return check_.unconfirmed_stops(); }
  std::uint64_t refused_control_events() const { return check_.refused_control_events(); }
  std::uint64_t unverified_transactions() const { return check_.unverified_transactions(); }
  const std::vector<DroneName>& drones() const { return config_.drones; }
  DroneReport report(DroneNumber drone) const;

 private:
  struct Drone {
    Fusion fusion;
    std::optional<StateSample> newest;
    TimeNs heard_ns = 0;  ///< when it came
    bool has_pose = false;
    TimeNs last_command_verified_ns = 0;
    TimeNs next_stop_ns = 0;
    Histogram two_way;
  };
  void repeat_stop(TimeNs now, const StateSample& sample, AgentOutputs& out);
  std::size_t index(DroneNumber drone) const;  ///< drones_.size(): not ours
  void hand_over_plans(TimeNs now, AgentOutputs& out);
  void submit_frame(TimeNs now, AgentOutputs& out);
  void submit_transitions(TimeNs now, AgentOutputs& out);
  void submit_apply_stops(TimeNs now, AgentOutputs& out);
  void submit_evictions(TimeNs now, AgentOutputs& out);
  void submit_alarm(TimeNs now, AgentOutputs& out);
  void take_checked(TimeNs now, const fabric::Block& block, const CommandCheck::Checked& checked, AgentOutputs& out);
  void violation_block(TimeNs now, const fabric::Block& block, const CommandCheck::Checked& checked);
  std::uint64_t newest_block() const { return height() == 0 ? 0 : height() - 1; }
  bool take_eviction(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome, AgentOutputs& out);
  void progress(TimeNs now);
  bool may_send_heartbeat(TimeNs now);

  AgentConfig config_;
  Batcher batcher_;
  TransitionSender transitions_;
  StopApplier stop_applier_;
  IdleEvictor idle_;
  AlarmSender alarms_;
  CommandCheck check_;
  fabric::ValidatedShare validated_share_;
  IntegrityMonitor integrity_;
  std::vector<Drone> drones_;  ///< as in config_.drones
  std::vector<Plan> checked_;  ///< waiting for step()
  TimeNs real_offset_ns_ = 0;
  TimeNs next_heartbeat_ns_ = INT64_MIN;
  std::optional<TimeNs> first_step_ns_;
  CheckLog checks_;
  TimeNs stepped_ns_ = INT64_MIN;  ///< last
  bool submitting_ = true;
  std::uint64_t blocks_ = 0;
  std::string last_chain_error_;
  bool ever_progress_ = false;
  std::optional<TimeNs> unanswered_since_ns_;  ///< first call sent after the last sign of life
  std::optional<TimeNs> disconnected_since_ns_;
};

}  // namespace ledgerline::agent
