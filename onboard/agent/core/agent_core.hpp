#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/check.hpp"
#include "common/base/enum_count.hpp"
#include "common/fabric/calls/outcome.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/rt/histogram.hpp"
#include "common/rt/trace.hpp"
#include "onboard/agent/core/command_check.hpp"
#include "onboard/agent/core/mocap.hpp"
#include "onboard/agent/core/outbox/batcher.hpp"
#include "onboard/agent/core/outbox/control_calls.hpp"
#include "onboard/agent/core/outbox/integrity.hpp"
#include "onboard/agent/core/outbox/transition_sender.hpp"

namespace ledgerline::agent {

struct AgentCoreSettings {
  std::vector<DroneName> drones;
  BatchSettings batch;
  CommandCheckSettings check;
  FusionSettings fusion;
  TimeNs heartbeat_period_ns = 50 * ns_per_ms;
  TimeNs first_heartbeat_wait_ns = 200 * ns_per_ms;  ///< for a pose of every drone, at most
  TimeNs ledger_silent_after_ns = 1 * ns_per_s;
  TimeNs idle_evict_ns = usual_idle_ns;  ///< 0: never, see IdleEvictor
  /// How long an integrity violation counts: longer than a stream's reconnect, and than the time between two
  /// comparisons with another organisation's records. Half: a ledger under lasting tampering would be trusted
  /// repeatedly. Double: drones stay on the ground for longer, where link asks for that.
  TimeNs integrity_hold_ns = 10 * ns_per_s;
  std::uint64_t seed = 1;  ///< of the back-off's jitter
};

/// What the agent wants done. Calls of AgentCore append; the shell acts on it and clears it.
struct AgentOutputs {
  struct Submit {
    std::uint64_t call_number = 0;  ///< give it back to on_outcome()
    fabric::Call call;
    bool urgent = false;  ///< all but states: must not wait behind them
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
  std::vector<CheckedBlock::UnconfirmedStop> unconfirmed_stops;
  std::vector<IntegrityMonitor::LogEntry> violations;  ///< for the log
  void clear();
};

/// Whether the ledger is alive: it answers what is sent, and its block stream is there.
class LedgerLiveness {
 public:
  explicit LedgerLiveness(TimeNs silent_after_ns) : silent_after_ns_(silent_after_ns) {}

  void on_call(TimeNs now) {
    if (!unanswered_since_ns_) unanswered_since_ns_ = now;
  }
  void on_progress();  ///< a block, or a call that is committed
  void on_connection(TimeNs now, bool connected);
  bool is_alive(TimeNs now) const;

 private:
  TimeNs silent_after_ns_;
  bool ever_progress_ = false;
  std::optional<TimeNs> unanswered_since_ns_;  ///< first call sent after the last sign of life
  std::optional<TimeNs> disconnected_since_ns_;
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

/// The agent without its I/O: sends states in batches, checks commands from blocks, fuses mocap, sends heartbeats.
/// Inputs first, then step() with the same or a later time: batches, verified plans and the heartbeat come out of
/// step() alone, so that `verified_ns` is the time of handing over, checking included. Call step() after every burst of
/// inputs, when due_ns() says so, and at least every few milliseconds: what is sent again after a failure waits for no
/// less. `now` never goes back. One thread; deterministic: the same inputs give the same outputs.
class AgentCore {
 public:
  /// The registry must outlive the core.
  AgentCore(AgentCoreSettings settings, crypto::MspRegistry& registry);

  /// Real time minus the monotonic clock: for ROS headers and certificates alone.
  void set_real_offset(TimeNs offset_ns) { real_offset_ns_ = offset_ns; }
  /// Control records as read from the ledger (`get control/<drone>`), before the first block is given.
  void set_control(TimeNs now, const Control& control);
  /// The records and roles that are trusted; they begin with set_control() and its set_roles().
  ControlCheck& control() { return check_.control(); }
  const ControlCheck& control() const { return check_.control(); }

  void on_state(TimeNs now, const StateSample& sample, AgentOutputs& out);
  void on_transition(const Transition& transition) { transitions_.add(transition); }
  void on_mocap(TimeNs now, DroneNumber drone, const MocapPose& measured, AgentOutputs& out);
  void on_outcome(TimeNs now, std::uint64_t call_number, const fabric::Outcome& outcome, AgentOutputs& out);
  void on_block(TimeNs now, const fabric::Block& block, AgentOutputs& out);
  /// One that the stream refused: stops are taken from it, and nothing else.
  void on_refused_block(TimeNs now, const fabric::Block& block, AgentOutputs& out);
  void on_connection(TimeNs now, bool connected) { liveness_.on_connection(now, connected); }  ///< of the block stream
  /// An integrity violation that was found outside, in words: by the stream, by another organisation's records.
  void on_violation(TimeNs now, IntegrityViolation kind, const std::string& words) {
    integrity_.add(now, kind, newest_block(), words);
  }
  void step(TimeNs now, AgentOutputs& out);
  /// Checks that failed in step(): the heartbeats say so from then on, and link lands the drones.
  const CheckLog& checks() const { return checks_; }
  /// After step(): when the next batch or heartbeat is due, if nothing comes before; INT64_MAX: none is.
  TimeNs due_ns() const;
  /// Writes integrity violations to the log now: step() does it, too, but not before there is a stream.
  void log_violations(TimeNs now, AgentOutputs& out);

  /// From now on step() makes no batch of states and evicts nobody; what is in flight may end, and transitions and
  /// apply_stops still go. For an orderly end.
  void stop_submitting() { submitting_ = false; }
  bool has_calls_in_flight() const {
    return batcher_.calls_in_flight() > 0 || transitions_.pending() || stop_applier_.pending() ||
           idle_.has_call_in_flight() || alarms_.has_call_in_flight();
  }

  bool ledger_alive(TimeNs now) const { return liveness_.is_alive(now); }
  std::uint64_t height() const { return check_.height(); }
  std::uint64_t blocks() const { return blocks_; }
  const std::string& last_chain_error() const { return last_chain_error_; }
  const CommandCheck& check() const { return check_; }
  const Batcher::Transactions& transactions() const { return batcher_.transactions(); }
  const StopApplier& stop_applier() const { return stop_applier_; }
  IntegrityMonitor& integrity() { return integrity_; }
  const IntegrityMonitor& integrity() const { return integrity_; }
  fabric::ValidatedShare& validated_share() { return validated_share_; }
  const fabric::ValidatedShare& validated_share() const { return validated_share_; }
  const AlarmSender& alarms() const { return alarms_; }
  const IdleEvictor& idle() const { return idle_; }
  const std::vector<DroneName>& drones() const { return settings_.drones; }
  DroneReport report(DroneNumber drone) const;

 private:
  struct Drone {
    DroneName drone;
    Fusion fusion;
    std::optional<StateSample> newest{};
    TimeNs newest_ns = 0;  ///< when it came
    bool has_pose = false;
    TimeNs last_command_verified_ns = 0;
    TimeNs next_stop_ns = 0;
    Histogram two_way{};
  };
  void repeat_stop(TimeNs now, const StateSample& sample, Drone& drone, AgentOutputs& out);
  void hand_over_plans(TimeNs now, AgentOutputs& out);
  /// Who makes calls, each numbering its own. All calls: number * senders + sender.
  enum class Sender : std::uint8_t { batcher, transitions, stop_applier, idle_evictor, alarms };
  static constexpr std::uint64_t senders = enum_count<Sender>;
  void submit(TimeNs now, Sender sender, std::uint64_t number, fabric::Call call, AgentOutputs& out);
  /// False: no such call is in flight.
  bool end_batch(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome, AgentOutputs& out);
  void submit_batch(TimeNs now, AgentOutputs& out);
  void submit_evictions(TimeNs now, AgentOutputs& out);
  void apply(TimeNs now, const fabric::Block& block, const CheckedBlock& checked, AgentOutputs& out);
  void add_violations(TimeNs now, const fabric::Block& block, const CheckedBlock& checked);
  std::uint64_t newest_block() const { return height() == 0 ? 0 : height() - 1; }
  bool end_eviction(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome, AgentOutputs& out);
  bool may_send_heartbeat(TimeNs now) const;

  AgentCoreSettings settings_;
  Batcher batcher_;
  TransitionSender transitions_;
  StopApplier stop_applier_;
  IdleEvictor idle_;
  AlarmSender alarms_;
  CommandCheck check_;
  fabric::ValidatedShare validated_share_;
  IntegrityMonitor integrity_;
  LedgerLiveness liveness_;
  std::vector<Drone> drones_;
  std::vector<Plan> checked_;  ///< waiting for step()
  TimeNs real_offset_ns_ = 0;
  TimeNs next_heartbeat_ns_ = INT64_MIN;
  std::optional<TimeNs> first_step_ns_;
  CheckLog checks_;
  TimeNs stepped_ns_ = INT64_MIN;  ///< last
  bool submitting_ = true;
  std::uint64_t blocks_ = 0;
  std::string last_chain_error_;
};

}  // namespace ledgerline::agent
