#include "onboard/agent/shell/ledger_follower.hpp"

#include <fmt/format.h>

#include <chrono>
#include <utility>

#include "common/base/log.hpp"
#include "common/rt/loop_ticker.hpp"
#include "common/rt/retry.hpp"

namespace ledgerline::agent {
namespace {

constexpr TimeNs turn_ns = 100 * ns_per_ms;
// Two peers of one channel are a block apart, rarely more: long beside that, short beside what a lie could do.
constexpr TimeNs again_ns = 500 * ns_per_ms;
constexpr TimeNs max_catching_up_ns = 1 * ns_per_s;  // then the wait is logged

std::vector<std::string> names_of(const std::vector<DroneName>& drones) {
  std::vector<std::string> names;
  for (const DroneName& drone : drones) names.push_back(drone.name);
  return names;
}

std::optional<FirstRecords> records_in(const fabric::StoredCheckpoint& kept, const std::vector<DroneName>& drones,
                                       const std::string& label) {
  if (!kept.last) return std::nullopt;
  auto records = records_from(kept.last->records, names_of(drones));
  if (records) return std::move(*records);
  spdlog::warn("{}the checkpoint at block {}: {}: the control records are read again", label, kept.last->number,
               records.error().message);
  return std::nullopt;
}

/// Asks until it is stopped.
template <typename Ask>
verification::Evaluate stoppable(const std::stop_token& stop, Ask ask) {
  return [&stop, ask](const fabric::Call& call) -> Result<std::string> {
    if (stop.stop_requested()) return Error{"asked to end"};
    return ask(call);
  };
}

}  // namespace

RecordReader::RecordReader(Mailbox& mailbox, std::string label, std::vector<std::string> drones, fabric::Client& client,
                           std::unique_ptr<fabric::Client> witness, TimeNs recheck_ns)
    : mailbox_(mailbox),
      label_(std::move(label)),
      drones_(std::move(drones)),
      client_(client),
      witness_(std::move(witness)),
      recheck_ns_(recheck_ns) {}

void RecordReader::require_witness() {
  unconfirmed_ = witness_ != nullptr;
  if (!witness_)
    spdlog::warn("{}no [[endorser]] of another organisation is configured: control records rest on our own peer alone",
                 label_);
}

Result<FirstRecords> RecordReader::read() {
  auto records = read_from([this](const fabric::Call& call) { return client_.evaluate(call); });
  if (!records) return records;
  if (auto status = confirm(*records); !status) return status.error();
  return records;
}

Result<FirstRecords> RecordReader::read_from(const verification::Evaluate& evaluate) const {
  auto controls = verification::read_controls(drones_, evaluate);
  if (!controls) return controls.error();
  auto roles = verification::read_roles(evaluate, verification::organisations_of(*controls));
  if (!roles) return roles.error();
  return FirstRecords{std::move(*controls), std::move(*roles)};
}

Status RecordReader::confirm(const FirstRecords& records) {
  if (!unconfirmed_) return done;
  const auto theirs = read_from([this](const fabric::Call& call) { return witness_->evaluate_at_peer(call); });
  if (!theirs)
    return Error{
        fmt::format("another organisation's peer does not report the control records, which a start after a "
                    "long absence needs of two: {}",
                    theirs.error().message)};
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

void RecordReader::read_in_background() {
  control_reader_ = std::jthread([this](const std::stop_token& stop) {
    Result<FirstRecords> records = Error{"not read yet"};
    const Status status = verification::read_repeatedly(stop, [&]() -> Status {
      records = read();
      return records ? Status(done) : records.error();
    });
    if (stop.stop_requested()) return;
    mailbox_.put(RecordsRead{status ? std::move(records) : status.error()});
  });
}

void RecordReader::read_roles(verification::Organisations organisations) {
  unread_.merge(organisations);
  if (unread_.empty() || role_reader_) return;
  role_reader_.emplace([this, asked = std::exchange(unread_, {})](const std::stop_token& stop) {
    auto roles = verification::read_roles(
        stoppable(stop, [this](const fabric::Call& call) { return client_.evaluate(call); }), asked);
    if (!roles) wait(stop, false);  // one that does not answer now is not asked at each block
    mailbox_.put(RolesRead{asked, std::move(roles)});
  });
}

void RecordReader::on_roles(const RolesRead& read) {
  role_reader_.reset();  // its last act was this event
  if (read.roles) return;
  spdlog::warn("{}{}; tried again with the next block", label_, read.roles.error().message);
  unread_.insert(read.organisations.begin(), read.organisations.end());
}

void RecordReader::watch_witness() {
  if (!witness_ || recheck_ns_ <= 0) return;
  witness_reader_ = std::jthread([this](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      mailbox_.put(SecondReading{
          read_from(stoppable(stop, [this](const fabric::Call& call) { return witness_->evaluate_at_peer(call); }))});
      wait(stop, true);
    }
  });
}

void RecordReader::wait(const std::stop_token& stop, bool may_be_shortened) const {
  for (TimeNs waited_ns = 0; waited_ns < recheck_ns_ && !stop.stop_requested(); waited_ns += turn_ns) {
    if (may_be_shortened && recheck_early_ && waited_ns >= again_ns) return;
    std::this_thread::sleep_for(std::chrono::nanoseconds(turn_ns));
  }
}

void raise_priority(int priority, const char* thread) {
  if (priority == 0) return;
  if (const Status status = schedule_fifo(priority); !status) spdlog::warn("{}: {}", thread, status.error().message);
}

LedgerFollower::LedgerFollower(Parts parts)
    : settings_(parts.settings),
      label_(std::move(parts.label)),
      several_(parts.several),
      core_(parts.core),
      out_(parts.out),
      mailbox_(parts.mailbox),
      client_(parts.client),
      checkpoint_block_(parts.kept.last ? parts.kept.last->number : 0),
      kept_records_(records_in(parts.kept, core_.drones(), label_)),
      // Without their records, blocks from before now would change records from now.
      blocks_({.label = label_,
               .kept = std::move(parts.kept),
               .max_absence_blocks = kept_records_ ? settings_.max_absence_blocks : 0,
               .program_stores = true}),
      records_(mailbox_, label_, names_of(core_.drones()), client_, std::move(parts.witness), settings_.recheck_ns) {}

void LedgerFollower::start() {
  records_.watch_witness();
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [this](const fabric::Block& block, std::string_view) {
    thread_local bool first = true;  // two threads bring blocks where an orderer's are read
    if (std::exchange(first, false)) raise_priority(settings_.priority, "the block stream");
    mailbox_.put_in_turn(block);
  };
  handlers.on_connection = [this](bool connected, const std::string& why) {
    mailbox_.put(StreamState{connected, why});
  };
  handlers.on_contradiction = [this](const std::string& what) { mailbox_.put(Contradiction{what}); };
  handlers.on_refused = [this](const fabric::Block& block) { mailbox_.put_in_turn(RefusedBlock{block}); };
  handlers.on_confirmed = [this](const Confirmed& confirmed) { mailbox_.put(confirmed); };
  handlers.on_continued = [this](const fabric::Continuation& how) { mailbox_.put(how); };
  blocks_.open(client_, std::move(handlers));
}

Status LedgerFollower::reach(const std::atomic<bool>& quit, AgentLog& log) {
  if (auto status = wait_for_block_stream(quit, log); !status) return status;
  if (control_start_.known()) return done;  // by the checkpoint and the blocks since
  return retry(
      label_ + "the control records can be read", {.within_ns = settings_.start_wait_ns}, [&] { return quit.load(); },
      [this]() -> Status {
        const auto records = records_.read();
        if (!records) return records.error();
        set_records(*records);
        return done;
      });
}

Status LedgerFollower::wait_for_block_stream(const std::atomic<bool>& quit, AgentLog& log) {
  const auto is_open = [&]() -> Status {
    const TimeNs until_ns = monotonic_ns() + max_catching_up_ns;
    do {
      if (auto status = handle_early_events(log); !status) return status;
      if (stream_.connected && core_.height() >= catch_up_to_) return done;
      if (stream_.connected) mailbox_.wait(1 * ns_per_ms);  // the blocks since the checkpoint, a box of them at a time
    } while (stream_.connected && monotonic_ns() < until_ns);
    if (stream_.connected)
      return Error{fmt::format("of the {} blocks since the checkpoint {} have come",
                               catch_up_to_ - 1 - checkpoint_block_,
                               core_.height() == 0 ? 0 : core_.height() - checkpoint_block_ - 1)};
    return Error{stream_.why.empty() ? "no answer yet" : stream_.why};
  };
  return retry(
      label_ + "the ledger's block stream is open", {.within_ns = settings_.start_wait_ns}, [&] { return quit.load(); },
      is_open);
}

Status LedgerFollower::handle_early_events(AgentLog& log) {
  for (Event& event : mailbox_.pop_all()) {
    // Both are held against records, which are not there or not up to date yet.
    if (std::holds_alternative<RefusedBlock>(event) || std::holds_alternative<SecondReading>(event)) continue;
    if (auto status = handle(event); !status) return status;
  }
  core_.log_violations(monotonic_ns(), out_);
  log.violations(out_);
  out_.violations.clear();
  return done;
}

Status LedgerFollower::handle(Event& event) {
  const TimeNs now = monotonic_ns();
  if (const auto* block = std::get_if<fabric::Block>(&event)) return on_block(*block);
  if (const auto* read = std::get_if<RecordsRead>(&event)) return on_records(*read);
  if (const auto* refused = std::get_if<RefusedBlock>(&event)) {
    core_.on_refused_block(now, refused->block, out_);
  } else if (auto* state = std::get_if<StreamState>(&event)) {
    core_.on_connection(now, state->connected);
    stream_ = std::move(*state);
  } else if (const auto* continued = std::get_if<fabric::Continuation>(&event)) {
    on_continued(*continued);
  } else if (auto* confirmed = std::get_if<Confirmed>(&event)) {
    confirmed_ = std::move(*confirmed);
  } else if (const auto* contradiction = std::get_if<Contradiction>(&event)) {
    core_.on_violation(now, IntegrityViolation::stream, contradiction->what);
  } else if (const auto* second = std::get_if<SecondReading>(&event)) {
    on_second_reading(*second);
  } else if (const auto* roles = std::get_if<RolesRead>(&event)) {
    records_.on_roles(*roles);
    if (roles->roles) core_.control().add_roles(*roles->roles);
    report_left_out();
  }
  return done;
}

void LedgerFollower::on_continued(const fabric::Continuation& how) {
  if (how.gap) {
    blocks_not_read_ = how.newest - how.verified;
    spdlog::warn(
        "{}they are more than {} behind the checkpoint: block {} counts {}, and the control records are read again",
        label_, settings_.max_absence_blocks, how.newest,
        settings_.blocks_are_validated ? "by its orderers' signatures"
                                       : "by the peer's word, for config_block is not set");
    records_.require_witness();
    return;
  }
  if (!kept_records_) return;
  spdlog::info("{}goes on behind block {}, which was verified; the chain is at {}", label_, how.verified, how.newest);
  set_records(*kept_records_);
  (void)control_start_.on_read();  // it comes before the first block
  catch_up_to_ = how.newest > how.verified ? how.newest + 1 : 0;
}

Status LedgerFollower::on_block(const fabric::Block& block) {
  if (block.confirmed)
    confirmed_ = {block.number, fabric::block_header_hash(block.number, block.previous_hash, block.data_hash)};
  const auto next = control_start_.on_block(block);
  if (!next && !several_) return next.error();
  if (!next) {
    control_start_.forget();
  } else if (*next == verification::ControlStart::Next::take) {
    core_.on_block(monotonic_ns(), block, out_);
    report_by_flag();
    records_.read_roles(core_.control().await_roles());
  } else if (*next == verification::ControlStart::Next::read) {
    records_.read_in_background();
  }
  return done;
}

void LedgerFollower::set_records(const FirstRecords& records) {
  core_.control().set_roles(records.roles);
  for (const Control& control : records.controls) core_.set_control(monotonic_ns(), control);
  report_left_out();
}

// Of several channels one whose records cannot be read ends nothing: the others' drones would be held on the ground by
// each start of the agent.
Status LedgerFollower::on_records(const RecordsRead& read) {
  if (!read.records && !several_) return read.records.error();
  if (!read.records || control_start_.is_useless()) {
    spdlog::error(
        "{}{}. Its drones are not flown until they are read, which is tried again at its next block", label_,
        read.records ? "too many blocks came while the control records were read" : read.records.error().message);
    control_start_.restart();
    return done;
  }
  set_records(*read.records);
  for (const fabric::Block& block : control_start_.on_read()) core_.on_block(monotonic_ns(), block, out_);
  return done;
}

void LedgerFollower::on_second_reading(const SecondReading& reading) {
  const std::string problem = reading.records ? "" : reading.records.error().message;
  if (problem != witness_problem_ && !problem.empty())
    spdlog::warn("{}the control records of another organisation's peer cannot be read: {}", label_, problem);
  witness_problem_ = problem;
  const bool own_are_read = control_start_.known();
  records_.set_early_recheck(reading.records && !own_are_read);
  if (!reading.records || !own_are_read) return;
  const auto verdict = second_opinion_.compare(core_.control().records(), *reading.records);
  for (const SecondOpinion::Difference& difference : verdict.alarms) {
    core_.on_violation(monotonic_ns(), IntegrityViolation::records, difference.text());
    spdlog::error(
        "{}{}: another organisation's peer reports another record than this agent trusts: here {}; there {}. One of "
        "the two peers lies or stands still: look at both before you fly",
        label_, difference.what, difference.ours, difference.theirs);
  }
  core_.integrity().records_differ(second_opinion_.differs());
  for (const std::string& what : verdict.cleared)
    spdlog::warn("{}{}: another organisation's peer reports the same record again", label_, what);
  records_.set_early_recheck(verdict.again_soon);
}

// No reason to distrust the ledger either: a flood of somebody's keys is none.
void LedgerFollower::report_by_flag() {
  const auto rise = core_.validated_share().pop_rise();
  if (!rise) return;
  spdlog::warn(
      "{}of {} transactions {} count by the peer's flag alone, since what they rest on is not known here any more: "
      "does somebody write many keys?",
      label_, rise->of, rise->by_flag);
}

// No reason to distrust the ledger: an organisation that has too many roles would land others' drones by it.
void LedgerFollower::report_left_out() {
  const verification::Organisations& left_out = core_.control().roles_left_out();
  if (left_out.size() == std::exchange(left_out_reported_, left_out.size())) return;
  for (const std::string& msp_id : left_out)
    spdlog::error(
        "{}the roles of {} are too many, or damaged, and are left out: a stop of its people counts only as the "
        "ledger's own, endorsed by our peer",
        label_, msp_id);
}

// Records and block belong together: while the records are being read, the core has taken no block. Blocks that are not
// confirmed yet hold states and commands alone, and change no record.
void LedgerFollower::store_checkpoint() {
  if (!blocks_.has_checkpoint_file() || !control_start_.known() || !confirmed_ || core_.height() == 0) return;
  blocks_.store(confirmed_->number, confirmed_->hash, to_bytes(core_.control().records()));
  confirmed_.reset();
}

void LedgerFollower::count(ShellCounters& counters) const {
  counters.blocks_not_read = blocks_not_read_;
  counters.records_compared = second_opinion_.comparisons();
  counters.records_differ = second_opinion_.alarms();
  counters.confirmed_after_ms = blocks_.confirmed_after_ms();
}

}  // namespace ledgerline::agent
