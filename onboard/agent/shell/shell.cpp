#include "onboard/agent/shell/shell.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "common/base/log.hpp"
#include "common/base/printable.hpp"
#include "common/msg/ros.hpp"
#include "common/program/program.hpp"

namespace ledgerline::agent {
namespace {

constexpr TimeNs log_gap_ns = 1 * ns_per_s;       // of one kind of message
constexpr TimeNs unheard_gap_ns = 10 * ns_per_s;  // a peer may be away for long
constexpr TimeNs clock_period_ns = 1 * ns_per_s;  // real time may be slewed

}  // namespace

bool due(TimeNs now, TimeNs& next, TimeNs period_ns) {
  if (now < next) return false;
  next = now + period_ns;
  return true;
}

// The narrowest of three readings: this thread may be put aside between two clocks, and mocap stamps would all move.
TimeNs real_offset() {
  TimeNs narrowest = std::numeric_limits<TimeNs>::max(), offset = 0;
  for (int i = 0; i < 3; ++i) {
    const TimeNs before = monotonic_ns(), real = realtime_ns(), after = monotonic_ns();
    if (after - before >= narrowest) continue;
    narrowest = after - before;
    offset = real - (before + narrowest / 2);
  }
  return offset;
}

AgentShell::AgentShell(Settings settings, std::unique_ptr<crypto::MspRegistry> registry,
                       std::unique_ptr<fabric::Client> client, std::unique_ptr<fabric::Client> urgent,
                       std::unique_ptr<fabric::Client> witness, dds::ParticipantPtr participant,
                       std::optional<fabric::Checkpoint> checkpoint, const std::atomic<bool>& quit)
    : settings_(std::move(settings)),
      quit_(quit),
      registry_(std::move(registry)),
      core_(settings_.core, *registry_),
      checkpoint_(std::move(checkpoint)),
      participant_(std::move(participant)),
      client_(std::move(client)),
      urgent_(std::move(urgent)),
      witness_(std::move(witness)) {
  for (const DroneName& drone : core_.drones()) names_.push_back(drone.name);
}

AgentShell::~AgentShell() { mailbox_.close(); }

bool AgentShell::flies(DroneNumber drone) const {
  return std::any_of(core_.drones().begin(), core_.drones().end(),
                     [&](const DroneName& ours) { return ours.number == drone; });
}

Status AgentShell::take_inputs(bool link_woke) {
  link_woke_ = link_woke;
  if (link_woke) ++counters_.link_wakes;
  if (auto status = take_events(); !status) return status;
  take_mocap();
  return done;
}

Status AgentShell::take_events() {
  for (Event& event : mailbox_.take_all()) {
    const TimeNs now = monotonic_ns();
    if (auto* block = std::get_if<fabric::Block>(&event)) {
      if (auto status = take_block(std::move(*block)); !status) return status;
    } else if (const auto* refused = std::get_if<RefusedBlock>(&event)) {
      core_.on_refused_block(now, refused->block, out_);
    } else if (const auto* ended = std::get_if<FrameEnded>(&event)) {
      core_.on_outcome(now, ended->frame, ended->outcome, out_);
      tell_outcome(ended->outcome);
    } else if (const auto* state = std::get_if<StreamState>(&event)) {
      core_.on_connection(now, state->connected);
      tell_connection_(state->connected, state->why);
    } else if (const auto* continued = std::get_if<Continued>(&event)) {
      take_continued(continued->how);
    } else if (auto* confirmed = std::get_if<Confirmed>(&event)) {
      confirmed_ = std::move(*confirmed);
    } else if (const auto* contradiction = std::get_if<Contradiction>(&event)) {
      core_.on_violation(now, IntegrityViolation::stream, contradiction->what);
    } else if (const auto* second = std::get_if<SecondReading>(&event)) {
      take_second_reading(*second);
    } else if (const auto* read = std::get_if<RecordsRead>(&event)) {
      if (auto status = take_records(*read); !status) return status;
    } else if (const auto* roles = std::get_if<RolesRead>(&event)) {
      take_roles(*roles);
    }
    step_and_act();
  }
  return done;
}

Status AgentShell::take_block(fabric::Block block) {
  if (block.confirmed)
    confirmed_ = {block.number, fabric::block_header_hash(block.number, block.previous_hash, block.data_hash)};
  const auto next = control_start_.on_block(block);
  if (!next && !several_) return next.error();
  if (!next) {
    control_start_.forget();
    return done;
  }
  if (*next == verification::ControlStart::Next::take) {
    core_.on_block(monotonic_ns(), block, out_);
    tell_by_flag();
    unread_.merge(core_.await_roles());
    if (!unread_.empty() && !role_reader_)
      role_reader_.emplace([this, organisations = std::exchange(unread_, {})](const std::stop_token& stop) {
        read_roles(stop, organisations);
      });
  }
  if (*next == verification::ControlStart::Next::read)
    control_reader_ = std::jthread([this](const std::stop_token& stop) { read_records_again(stop); });
  return done;
}

void AgentShell::set_records(const FirstRecords& records) {
  core_.set_roles(records.roles);
  for (const Control& control : records.controls) core_.set_control(monotonic_ns(), control);
  tell_left_out();
}

void AgentShell::take_roles(const RolesRead& read) {
  role_reader_.reset();  // its last act was this event
  if (read.roles) {
    core_.add_roles(*read.roles);
    tell_left_out();
    return;
  }
  spdlog::warn("{}{}; tried again with the next block", label_, read.roles.error().what);
  unread_.insert(read.organisations.begin(), read.organisations.end());
}

// No reason to distrust the ledger either: a flood of somebody's keys is none.
void AgentShell::tell_by_flag() {
  const auto rise = core_.validated_share().take_rise();
  if (!rise) return;
  spdlog::warn(
      "{}of {} transactions {} count by the peer's flag alone, since what they rest on is not known here any more: "
      "does "
      "somebody write many keys?",
      label_, rise->of, rise->by_flag);
}

// No reason to distrust the ledger: an organisation that has too many roles would land others' drones by it.
void AgentShell::tell_left_out() {
  const verification::Organisations& left_out = core_.roles_left_out();
  if (left_out.size() == std::exchange(left_out_reported_, left_out.size())) return;
  for (const std::string& msp_id : left_out)
    spdlog::error(
        "{}the roles of {} are too many, or damaged, and are left out: a stop of its people counts only as the "
        "ledger's "
        "own, endorsed by our peer",
        label_, msp_id);
}

// Of several channels one whose records cannot be read ends nothing: the others' drones would be held on the ground by
// each start of the agent.
Status AgentShell::take_records(const RecordsRead& read) {
  if (!read.records && !several_) return read.records.error();
  if (!read.records || control_start_.is_useless()) {
    spdlog::error(
        "{}{}. Its drones are not flown until they are read, which is tried again at its next block", label_,
        read.records ? "too many blocks came while the control records were read" : read.records.error().what);
    control_start_.restart();
    return done;
  }
  set_records(*read.records);
  for (const fabric::Block& block : control_start_.on_read()) core_.on_block(monotonic_ns(), block, out_);
  return done;
}

void AgentShell::take_second_reading(const SecondReading& reading) {
  const std::string problem = reading.records ? "" : reading.records.error().what;
  if (problem != witness_problem_ && !problem.empty())
    spdlog::warn("{}the control records of another organisation's peer cannot be read: {}", label_, problem);
  witness_problem_ = problem;
  ask_again_ = reading.records && !control_start_.known();  // our own are still being read
  if (!reading.records || ask_again_) return;
  const auto verdict = second_opinion_.compare(core_.records(), *reading.records);
  for (const SecondOpinion::Difference& difference : verdict.alarms) {
    core_.on_violation(monotonic_ns(), IntegrityViolation::records, difference.text());
    spdlog::error(
        "{}{}: another organisation's peer reports another record than this agent trusts: here {}; there {}. One of "
        "the two peers lies or stands still: look at both before you fly",
        label_, difference.what, difference.ours, difference.theirs);
  }
  core_.set_records_differ(second_opinion_.differs());
  for (const std::string& what : verdict.cleared)
    spdlog::warn("{}{}: another organisation's peer reports the same record again", label_, what);
  ask_again_ = verdict.again_soon;
  counters_.records_compared = second_opinion_.comparisons();
  counters_.records_differ = second_opinion_.alarms();
}

void AgentShell::take_state(const StateSample& sample) {
  core_.on_state(monotonic_ns(), sample, out_);
  if (!link_woke_) ++counters_.states_without_wake;
}

void AgentShell::finish_turn() {
  step_and_act();
  run_periodic_tasks(monotonic_ns());
}

void AgentShell::take_mocap() {
  for (Mocap& mocap : mocap_) {
    MocapMessage message{};
    while (mocap.ring->pop(message)) {
      if (const auto pose = mocap_intake_.take(message)) {
        core_.on_mocap(monotonic_ns(), mocap.drone, *pose, out_);
      } else {
        tell_implausible(mocap.drone, message);
      }
    }
  }
}

void AgentShell::tell_implausible(DroneNumber drone, const MocapMessage& message) {
  ++counters_.mocap_implausible;
  if (std::exchange(mocap_warned_, true)) return;
  const TimeNs stamp_ns = message.source_real_ns - mocap_intake_.clock().offset_ns();
  spdlog::warn(
      "{}a mocap pose of drone {} is not trusted (stamp {:.0f} ms before its arrival, quaternion's norm {:.3f}); "
      "if its computer's clock differs from this one's, set clock = \"arrival\" in [mocap]",
      label_, drone, to_ms(message.arrived_ns - stamp_ns), MocapIntake::norm(message));
}

// What link waits for goes first; signing a frame takes a moment.
void AgentShell::step_and_act() {
  core_.step(monotonic_ns(), out_);
  for (const Plan& plan : out_.plans) {
    if (end_->send_plan(plan)) continue;
    ++counters_.plans_not_handed_over;
    spdlog::error("{}drone {}: plan {} was lost, no shared memory is left: is link running?", label_, plan.drone,
                  plan.sequence);
  }
  // A lost pose or heartbeat is made good by the next one; link watches their age.
  for (const Pose& pose : out_.poses) (void)end_->send_pose(pose);
  if (out_.heartbeat) {
    out_.heartbeat->drones = heartbeat_for_;
    (void)end_->send_heartbeat(*out_.heartbeat);
  }
  for (AgentOutputs::Submit& submit : out_.submits) {
    (submit.urgent ? urgent_ : client_)
        ->submit(std::move(submit.call), [this, frame = submit.frame](fabric::Outcome outcome) {
          mailbox_.put(FrameEnded{frame, std::move(outcome)});
        });
  }
  tell_refusals();
  tell_evictions();
  tell_unconfirmed_stops();
  log_violations();
  recorder_->add(out_.traces);
  out_.clear();
}

void AgentShell::tell_refusals() {
  for (const TraceRecord& record : out_.traces) {
    if (record.kind != TraceKind::refused || !due(record.t_ns, next_refusal_log_ns_, log_gap_ns)) continue;
    spdlog::warn("{}drone {}: command {} refused: {}{}", label_, record.drone, record.id,
                 refusal_name(static_cast<Refusal>(record.extra)),
                 record.extra == static_cast<std::uint32_t>(Refusal::broken_chain) ? ": " + core_.last_chain_error()
                                                                                   : std::string());
  }
}

void AgentShell::tell_unconfirmed_stops() {
  for (const auto& stop : out_.unconfirmed_stops) {
    spdlog::error(
        "{}drone {}: stopped by {} {}, which the block flags {}: it lands all the same; the stop is over when "
        "apply_stops shows that the ledger has no such stop",
        label_, stop.drone, stop.stopper.msp_id, printable(stop.stopper.subject), stop.code);
  }
}

void AgentShell::log_violations() {
  for (const IntegrityMonitor::Word& word : out_.violations)
    spdlog::error("{}the ledger is not trusted, {} ({} of {} since the last word): {}", label_, name(word.kind),
                  word.since, word.count, word.words);
}

void AgentShell::tell_evictions() {
  using Next = fabric::Repeat::Next;
  const double idle_s = to_seconds(core_.idle().idle_ns());
  for (const AgentOutputs::Eviction& eviction : out_.evictions) {
    if (!eviction.ended) {
      spdlog::info("{}{}: on the ground and no command of its holder for {:g} s: its lease is ended", label_,
                   eviction.drone, idle_s);
    } else if (*eviction.ended == Next::on_ledger) {
      spdlog::warn("{}{}: its idle holder has lost the lease; who wants to fly it acquires it", label_, eviction.drone);
    } else if (*eviction.ended == Next::again) {
      spdlog::warn("{}{}: its lease is not ended yet, tried again: {}", label_, eviction.drone, eviction.why);
    } else {
      spdlog::error("{}{}: its idle holder keeps the lease, tried again in {:g} s: {}{}", label_, eviction.drone,
                    idle_s, *eviction.ended == Next::refused ? "the contract refuses it: " : "", eviction.why);
    }
  }
}

void AgentShell::tell_outcome(const fabric::Outcome& outcome) {
  if (!outcome.unheard.empty() && due(monotonic_ns(), next_unheard_log_ns_, unheard_gap_ns))
    spdlog::warn("{}a call was endorsed by less than all peers that were asked: {}", label_, outcome.unheard);
  if (outcome.kind == fabric::Outcome::Kind::committed) return;
  if (!due(monotonic_ns(), next_outcome_log_ns_, log_gap_ns)) return;
  spdlog::warn("{}a call did not get through (block {}, code {}): {}", label_, outcome.block, outcome.code,
               outcome.message);
}

void AgentShell::tell_lost_transitions() {
  std::uint64_t lost = 0;
  for (const DroneName& drone : core_.drones()) lost += core_.report(drone.number).transitions.lost;
  if (lost > transitions_lost_)
    spdlog::error("{}{} transitions of the failsafe are lost: link had to keep more than it can", label_, lost);
  transitions_lost_ = lost;
}

void AgentShell::run_periodic_tasks(TimeNs now) {
  if (due(now, next_clock_ns_, clock_period_ns)) {
    mocap_intake_.clock().refresh();
    core_.set_real_offset(mocap_intake_.clock().offset_ns());
    tell_lost_transitions();
  }
  if (due(now, next_checkpoint_ns_, fabric::CheckpointKeeper::usual_period_ns)) keep_checkpoint();
}

// Records and block belong together: while the records are being read, the core has taken no block. Blocks that are not
// confirmed yet hold states and commands alone, and change no record.
void AgentShell::keep_checkpoint() {
  if (!keeper_ || !control_start_.known() || !confirmed_ || core_.height() == 0 || confirmed_->number == kept_) return;
  keeper_->keep({settings_.core.check.where.channel, confirmed_->number, confirmed_->hash, to_bytes(core_.records())});
  kept_ = confirmed_->number;
}

void AgentShell::write_status(TimeNs now, std::optional<std::int64_t> certificate_days) const {
  print_status(status_line(core_, channel(), now, certificate_days));
}

std::string AgentShell::end() {
  keep_checkpoint();
  counters_.mocap_lost = mocap_lost_;
  counters_.confirmed_after_ms = confirmations_.quantiles_ms();
  for (const Mocap& mocap : mocap_) {
    const dds::Refused refused = mocap.subscriber->refused();
    counters_.mocap_lost += refused.total();
  }
  return summary(core_, channel(), counters_);
}

}  // namespace ledgerline::agent
