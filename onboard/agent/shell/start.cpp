// AgentShell's beginning: everything that may not be there yet is waited for, for a bounded time.
#include <fmt/format.h>

#include <chrono>
#include <utility>

#include "common/base/log.hpp"
#include "common/msg/pose_messages.hpp"
#include "common/rt/real_time.hpp"
#include "common/rt/retry/keep_trying.hpp"
#include "onboard/agent/shell/shell.hpp"

namespace ledgerline::agent {
namespace {

constexpr TimeNs witness_turn_ns = 100 * ns_per_ms;
// Two peers of one channel are a block apart, rarely more: long beside that, short beside what a lie could do.
constexpr TimeNs witness_again_ns = 500 * ns_per_ms;
constexpr TimeNs max_catching_up_ns = 1 * ns_per_s;  // then the wait is logged

}  // namespace

Status AgentShell::keep_waiting(const std::string& what, const std::function<Status()>& attempt) const {
  return keep_trying(
      label_ + what, {.within_ns = settings_.start_wait_ns}, [this] { return quit_.load(); }, attempt);
}

Status AgentShell::start(ipc::AgentEnd& end, Recorder& recorder, bool several) {
  end_ = &end;
  recorder_ = &recorder;
  several_ = several;
  if (several) {
    label_ = fmt::format("channel {}: ", channel());
    heartbeat_for_ = 0;
    for (const DroneName& drone : core_.drones()) heartbeat_for_ |= AgentHeartbeat::bit_of(drone.number);
  }
  tell_connection_ = fabric::tell_connections(label_ + "block stream");
  core_.set_real_offset(mocap_intake_.clock().offset_ns());
  if (auto status = subscribe_to_mocap(); !status) return status;

  if (witness_ && settings_.recheck_ns > 0)
    witness_reader_ = std::jthread([this](const std::stop_token& stop) { ask_witness(stop); });
  open_checkpoint();
  open_block_stream();
  return done;
}

Status AgentShell::reach() {
  if (auto status = wait_for_block_stream(); !status) return status;
  if (control_start_.known()) return done;  // by the checkpoint and the blocks since
  return keep_waiting("the control records can be read", [this]() -> Status {
    const auto records = read_records();
    if (!records) return records.error();
    if (auto status = confirm(*records); !status) return status;
    set_records(*records);
    return done;
  });
}

// Behind a gap nothing connects what was verified with what the peer reports now: another organisation's must
// report the same.
Status AgentShell::confirm(const FirstRecords& records) {
  if (!unconfirmed_) return done;
  const auto theirs = read_records([this](const fabric::Call& call) { return witness_->evaluate_at_peer(call); });
  if (!theirs)
    return Error{
        fmt::format("another organisation's peer does not report the control records, which a start after a "
                    "long absence needs of two: {}",
                    theirs.error().what)};
  const auto differences = SecondOpinion::differences(records, *theirs);
  if (!differences.empty())
    return Error{fmt::format(
        "after a long absence two organisations' peers must report the same control records, and "
        "do not: {}{}",
        differences[0].text(), differences.size() > 1 ? fmt::format(", and {} more", differences.size() - 1) : "")};
  if (unconfirmed_.exchange(false))
    spdlog::info("{}another organisation's peer reports the same control records", label_);
  return done;
}

Result<FirstRecords> AgentShell::read_records() {
  return read_records([this](const fabric::Call& call) { return client_->evaluate(call); });
}

Result<FirstRecords> AgentShell::read_records(const verification::Evaluate& evaluate) const {
  auto controls = verification::read_controls(names_, evaluate);
  if (!controls) return controls.error();
  auto roles = verification::read_roles(evaluate, verification::organisations_of(*controls));
  if (!roles) return roles.error();
  return FirstRecords{std::move(*controls), std::move(*roles)};
}

Status AgentShell::subscribe_to_mocap() {
  if (settings_.mocap_topic.empty()) return done;
  for (const DroneName& drone : settings_.core.drones) {
    Mocap mocap;
    mocap.drone = drone.number;
    mocap.ring = std::make_unique<SpscRing<MocapMessage, 64>>();
    // Best effort hears both kinds of writers, and a pose that was lost is not worth sending again.
    auto subscriber = dds::RawReader::create(
        participant_, pose_topic_of(settings_.mocap_topic, drone.name), name(settings_.mocap_message),
        {.reliable = false},
        [this, ring = mocap.ring.get(), drone = drone.name](std::span<const std::uint8_t> cdr, const dds::RawInfo&) {
          const auto pose = pose_from_message(settings_.mocap_message, dds::text_of(cdr), drone);
          if (pose && !*pose) return;  // of others alone
          if (!pose ||
              !ring->push({(*pose)->header.stamp_ns, monotonic_ns(), (*pose)->position_m, (*pose)->orientation}))
            ++mocap_lost_;
          mailbox_.wake();
        });
    if (!subscriber) return subscriber.error();
    mocap.subscriber = std::move(subscriber).value();
    mocap_.push_back(std::move(mocap));
  }
  return done;
}

void raise_priority(int priority, const char* thread) {
  if (priority == 0) return;
  if (const Status status = schedule_fifo(priority); !status) spdlog::warn("{}: {}", thread, status.error().what);
}

void AgentShell::open_block_stream() {
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [this](const fabric::Block& block, std::string_view) {
    thread_local bool first = true;  // two threads bring blocks where an orderer's are read
    if (std::exchange(first, false)) raise_priority(settings_.priority, "the block stream");
    mailbox_.put_in_turn(block);
  };
  handlers.on_connection = [this](bool connected, const std::string& why) {
    mailbox_.put(StreamState{connected, why});
  };
  handlers.on_unverified = [this](const std::string& what) { spdlog::warn("{}{}", label_, what); };
  handlers.on_contradiction = [this](const std::string& what) { mailbox_.put(Contradiction{what}); };
  handlers.on_refused = [this](const fabric::Block& block) { mailbox_.put_in_turn(RefusedBlock{block}); };
  handlers.on_confirmed = [this](const auto& confirmed) {
    confirmations_.add(confirmed.ordered_ns, confirmed.confirmed_ns);
    mailbox_.put(Confirmed{confirmed.number, confirmed.hash});
  };
  handlers.on_orderers = fabric::tell_connections(label_ + "orderer's block stream");
  handlers.on_continued = [this](const fabric::Continuation& how) { mailbox_.put(Continued{how}); };
  if (!checkpoint_) {
    blocks_ = client_->blocks(std::nullopt, std::move(handlers));
    return;
  }
  // Without their records, blocks from before now would change records from now.
  const std::uint64_t max_absence = kept_records_ ? settings_.max_absence_blocks : 0;
  blocks_ = client_->blocks_behind({*checkpoint_, max_absence}, std::move(handlers));
}

void AgentShell::open_checkpoint() {
  if (settings_.checkpoint.empty()) return;
  keeper_ = std::make_unique<fabric::CheckpointKeeper>(settings_.checkpoint, [this](const std::string& why) {
    spdlog::error("{}the checkpoint is not kept: {}", label_, why);
  });
  if (!checkpoint_) {
    spdlog::warn("{}there is no checkpoint yet: this start trusts the chain that the peer serves", label_);
    return;
  }
  auto records = records_from(checkpoint_->records, names_);
  if (!records) {
    spdlog::warn("{}the checkpoint at block {}: {}: the control records are read again", label_, checkpoint_->number,
                 records.error().what);
    return;
  }
  kept_records_ = std::move(*records);
}

void AgentShell::take_continued(const fabric::Continuation& how) {
  if (how.gap) {
    counters_.blocks_not_read = how.newest - how.verified;
    spdlog::warn(
        "{}blocks {} to {} came while this agent was away, and are not read (more than {} behind the checkpoint): "
        "block {} counts {}, and the control records are read again",
        label_, how.verified + 1, how.newest, settings_.max_absence_blocks, how.newest,
        settings_.blocks_are_validated ? "by its orderers' signatures"
                                       : "by the peer's word, for config_block is not set");
    unconfirmed_ = witness_ != nullptr;
    if (!witness_)
      spdlog::warn(
          "{}no [[endorser]] of another organisation is named: those records are this organisation's peer's word alone",
          label_);
    return;
  }
  if (!kept_records_) return;
  spdlog::info("{}goes on behind block {}, which was verified; the chain is at {}", label_, how.verified, how.newest);
  set_records(*kept_records_);
  (void)control_start_.on_read();  // it comes before the first block
  catch_up_to_ = how.newest > how.verified ? how.newest + 1 : 0;
}

Status AgentShell::take_early_events() {
  for (Event& event : mailbox_.take_all()) {
    if (const auto* state = std::get_if<StreamState>(&event)) {
      core_.on_connection(monotonic_ns(), state->connected);
      connected_ = state->connected;
      stream_problem_ = state->why;
    } else if (const auto* continued = std::get_if<Continued>(&event)) {
      take_continued(continued->how);
    } else if (const auto* contradiction = std::get_if<Contradiction>(&event)) {
      core_.on_violation(monotonic_ns(), IntegrityViolation::stream, contradiction->what);
      core_.log_violations(monotonic_ns(), out_);
      log_violations();
      out_.violations.clear();
    } else if (const auto* read = std::get_if<RecordsRead>(&event)) {
      if (auto status = take_records(*read); !status) return status;
    } else if (const auto* roles = std::get_if<RolesRead>(&event)) {
      take_roles(*roles);
    } else if (auto* block = std::get_if<fabric::Block>(&event)) {
      if (auto status = take_block(std::move(*block)); !status) return status;
    }
  }
  return done;
}

Status AgentShell::wait_for_block_stream() {
  return keep_waiting("the ledger's block stream is open", [this]() -> Status {
    const TimeNs until_ns = monotonic_ns() + max_catching_up_ns;
    do {
      if (auto status = take_early_events(); !status) return status;
      if (connected_ && core_.height() >= catch_up_to_) return done;
      if (connected_) mailbox_.wait(1 * ns_per_ms);  // the blocks since the checkpoint, a box of them at a time
    } while (connected_ && monotonic_ns() < until_ns);
    if (connected_)
      return Error{fmt::format("of the {} blocks since the checkpoint {} have come",
                               catch_up_to_ - 1 - checkpoint_->number,
                               core_.height() == 0 ? 0 : core_.height() - checkpoint_->number - 1)};
    return Error{stream_problem_.empty() ? "no answer yet" : stream_problem_};
  });
}

void AgentShell::read_records_again(const std::stop_token& stop) {
  FirstRecords records;
  const Status status = verification::keep_reading(stop, [&]() -> Status {
    auto read = read_records();
    if (!read) return read.error();
    if (auto confirmed = confirm(*read); !confirmed) return confirmed;
    records = std::move(*read);
    return done;
  });
  if (stop.stop_requested()) return;
  mailbox_.put(RecordsRead{status ? Result<FirstRecords>(std::move(records)) : status.error()});
}

void AgentShell::read_roles(const std::stop_token& stop, const verification::Organisations& organisations) {
  const auto evaluate = [&](const fabric::Call& call) -> Result<std::string> {
    if (stop.stop_requested()) return Error{"asked to end"};
    return client_->evaluate(call);
  };
  auto roles = verification::read_roles(evaluate, organisations);
  // One that does not answer now is not asked at each block.
  for (TimeNs waited_ns = 0; !roles && waited_ns < settings_.recheck_ns && !stop.stop_requested();
       waited_ns += witness_turn_ns)
    std::this_thread::sleep_for(std::chrono::nanoseconds(witness_turn_ns));
  mailbox_.put(RolesRead{organisations, std::move(roles)});
}

void AgentShell::ask_witness(const std::stop_token& stop) {
  const verification::Evaluate evaluate = [&](const fabric::Call& call) -> Result<std::string> {
    if (stop.stop_requested()) return Error{"asked to end"};
    return witness_->evaluate_at_peer(call);
  };
  while (!stop.stop_requested()) {
    mailbox_.put(SecondReading{read_records(evaluate)});
    for (TimeNs waited_ns = 0; waited_ns < settings_.recheck_ns && !stop.stop_requested();
         waited_ns += witness_turn_ns) {
      if (ask_again_ && waited_ns >= witness_again_ns) break;
      std::this_thread::sleep_for(std::chrono::nanoseconds(witness_turn_ns));
    }
  }
}

}  // namespace ledgerline::agent
