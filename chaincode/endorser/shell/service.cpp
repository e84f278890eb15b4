#include "chaincode/endorser/shell/service.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/base/random.hpp"
#include "common/common.pb.h"
#include "common/rt/clock.hpp"
#include "common/rt/retry.hpp"

namespace ledgerline::endorser {
namespace {

constexpr std::chrono::minutes checkpoint_period{10};  // copying all takes some ten milliseconds
constexpr int max_tries = 5;
constexpr std::chrono::milliseconds again_after{20};
// Below a client's timeout with an endorser (ClientConfig::endorse_timeout).
constexpr std::chrono::milliseconds max_wait_for_check{200};
constexpr std::uint64_t any_absence = 1'000'000'000'000;  // blocks: none may be left out
constexpr TimeNs first_retry_ns = 50 * ns_per_ms, max_retry_ns = 1 * ns_per_s;

// The ids of some 60 million transactions: a fleet's of years. All files are held in memory while they are read, so
// that twice as much asks for a host of its own.
constexpr std::int64_t max_file_bytes = std::int64_t{4} << 30;

std::uint64_t seed() { return std::random_device{}(); }

/// Why a snapshot is not taken, with what to do about it.
std::string refused_first_state(const std::string& why) {
  return "first_state: " + why +
         ". Ask the peer for a new snapshot (peer snapshot submitrequest) and copy its whole folder; or leave "
         "first_state out: then the chain is read from its first block";
}

/// Reads the folder that first_state names. An error names folder and file, and says what to do.
Result<PeerSnapshot> read_first_state_folder(const FirstStateSettings& settings,
                                             const fabric::ChannelAndContract& where) {
  const auto refused = [](const std::string& why) { return Error{refused_first_state(why)}; };
  const auto folder = OwnedFolder::open(settings.folder);
  if (!folder) return refused(folder.error().message);
  PeerSnapshotFiles files;
  for (const auto& [name, content] : {std::pair{peer_snapshot_file::description, &files.description},
                                      {peer_snapshot_file::description_hash, &files.description_hash},
                                      {peer_snapshot_file::states, &files.states},
                                      {peer_snapshot_file::states_counts, &files.states_counts},
                                      {peer_snapshot_file::ids, &files.ids},
                                      {peer_snapshot_file::ids_count, &files.ids_count}}) {
    auto read = folder->read(std::string(name), max_file_bytes);
    if (!read) return refused(read.error().message);
    *content = std::move(*read);
  }
  auto reported = read_peer_snapshot(files, where, settings.hash);
  if (!reported) return refused(settings.folder + "/" + reported.error().message);
  return reported;
}

}  // namespace

SampledChecks::SampledChecks(int one_in) : one_in_(one_in), random_(seed()) {}

bool SampledChecks::add(Check one) {
  if (waiting_.size() >= max_waiting) return false;
  waiting_.push_back(std::move(one));
  ++added_;
  return true;
}

std::optional<SampledChecks::Check> SampledChecks::next() {
  if (waiting_.empty()) return std::nullopt;
  Check one = std::move(waiting_.front());
  waiting_.pop_front();
  return one;
}

Result<std::unique_ptr<Service>> Service::start(fabric::ClientConfig ledger, const Settings& settings,
                                                std::function<void()> on_failure) {
  if (ledger.config_block.empty())
    return Error{"ledger.config_block is missing: an endorser signs only by blocks that the channel's orderers signed"};
  if (!ledger.identity.in_use) ledger.identity.in_use = std::make_shared<crypto::IdentityInUse>(ledger.identity);
  auto peer = fabric::PeerQueries::create(ledger);
  if (!peer) return peer.error();
  auto client = fabric::Client::create(ledger);
  if (!client) return client.error();
  std::unique_ptr<Service> service(new Service(ledger, settings.check_one_in, std::move(on_failure)));
  Service& self = *service;
  self.peer_ = std::move(*peer);
  if (Status s = self.restore(settings.checkpoint, ledger.where); !s) return s.error();
  if (Status s = self.read_first_state(settings.first_state, ledger); !s) return s.error();
  self.client_ = std::move(*client);
  const bool begins_at_once = !self.first_state_;
  self.checker_ = std::thread([&self] { self.run_checks(); });
  const auto lock = self.mutex_.lock_first();
  if (begins_at_once) self.begin_stream();
  return service;
}

void Service::begin_stream() {
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [this](const fabric::Block& block, std::string_view raw) {
    on_block(BlockSources::Source::own, block, raw);
  };
  handlers.on_connection = [this](bool connected, const std::string& why) {
    on_connection(BlockSources::Source::own, connected, why);
  };
  handlers.on_unverified = [this](const std::string& what) { fail("the peer's blocks: " + what); };
  handlers.on_contradiction = [this](const std::string& what) { fail("the peer's blocks: " + what); };
  blocks_ =
      std::make_unique<fabric::BlockSubscription>(fabric::BlockSubscription::Config{.label = "endorser: ",
                                                                                    .kept = std::move(checkpoint_),
                                                                                    .first = 0,
                                                                                    .max_absence_blocks = any_absence,
                                                                                    .program_stores = true});
  blocks_->open(*client_, std::move(handlers));
}

Service::Service(fabric::ClientConfig ledger, int check_one_in, std::function<void()> on_failure)
    : identity_(ledger.identity.in_use),
      on_failure_(std::move(on_failure)),
      last_identity_(identity_->now()),
      core_({ledger.where, *last_identity_, fabric::BlockValidator::registry_of(ledger.verifier)}),
      checks_(check_one_in) {}

Service::~Service() {
  {
    const auto lock = mutex_.lock_first();
    stopping_ = true;
    checker_wakes_.notify_all();
    waiters_wake_.notify_all();
  }
  if (checker_.joinable()) checker_.join();
  if (blocks_) blocks_->close();
  store_checkpoint();
}

Status Service::restore(const std::string& path, const fabric::ChannelAndContract& where) {
  struct stat info {};
  if (!path.empty() && ::stat(path.c_str(), &info) == 0 && (info.st_uid != ::geteuid() || (info.st_mode & 077) != 0))
    return Error{fmt::format(
        "{}: others than its owner may read or write it, and it decides what is endorsed; run: chmod 600 {}", path,
        path)};
  auto kept = fabric::StoredCheckpoint::read(path, where.channel + "/" + where.contract);
  if (!kept) return kept.error();
  checkpoint_ = std::move(*kept);
  if (!checkpoint_.last) return done;
  const Status restored = core_.restore(checkpoint_.last->records);
  if (!restored || core_.height() != checkpoint_.last->number + 1 || core_.hash() != checkpoint_.last->hash)
    return Error{fmt::format("{}: {}; without it the chain is read from its first block", path,
                             restored ? "its state is of another block" : restored.error().message)};
  counts_.restored = core_.height();
  checkpoint_.last->records.clear();
  return done;
}

Status Service::read_first_state(const FirstStateSettings& settings, const fabric::ClientConfig& ledger) {
  if (settings.folder.empty())
    return settings.hash.empty() ? Status(done) : Error{"first_state_hash without first_state"};
  if (checkpoint_.last) {
    spdlog::info("endorser: it goes on behind its checkpoint: first_state is not read");
    return done;
  }
  auto reported = read_first_state_folder(settings, ledger.where);
  if (!reported) return reported.error();
  auto validator = fabric::BlockValidator::from(ledger.config_block, ledger.where.channel, ledger.verifier);
  if (!validator) return validator.error();
  first_state_.emplace(FirstState{std::move(*reported), std::move(*validator)});
  return done;
}

bool Service::begin_with_first_state(std::unique_lock<std::mutex>& lock) {
  bool reached = true;
  const auto fetch = [&](std::uint64_t number) -> Result<common::Block> {
    const auto bytes = peer_->block(number);
    common::Block block;
    if (bytes && block.ParseFromString(*bytes)) return block;
    reached = false;
    return Error{fmt::format("the peer does not give block {}: {}", number,
                             bytes ? "its answer is no block" : bytes.error().message)};
  };
  lock.unlock();
  const auto config_block = verify_snapshot(first_state_->reported, first_state_->validator, fetch);
  lock.lock();
  if (!config_block && !reached) {
    if (std::exchange(first_state_->problem, config_block.error().message) != config_block.error().message)
      spdlog::warn("endorser: first_state is not begun with yet: {}", config_block.error().message);
    return false;
  }
  const Status taken = config_block ? apply_first_state(*config_block) : config_block.error();
  first_state_.reset();
  if (taken) {
    spdlog::info("endorser: it begins with the peer's snapshot of block {}", core_.height() - 1);
    begin_stream();
  } else {
    stop_signing();  // before another block can come: there is no stream to take it
    lock.unlock();
    report_failure(refused_first_state(taken.error().message));
    lock.lock();
  }
  return true;
}

/// As from a checkpoint, from here on.
Status Service::apply_first_state(const std::string& config_block) {
  PeerSnapshot& reported = first_state_->reported;
  const Status restored = core_.restore(
      {std::move(reported.end), config_block, std::move(reported.contract), std::move(reported.lifecycle)});
  if (!restored) return restored;
  counts_.blocks = counts_.restored = core_.height();
  checkpoint_.last = fabric::Checkpoint{checkpoint_.channel, core_.height() - 1, core_.hash(), {}};
  return done;
}

/// What failed is not what another start is to begin with. With the lock held, or alone.
void Service::store_checkpoint() {
  if (!blocks_ || !blocks_->has_checkpoint_file() || readiness_.failed() || core_.height() == 0) return;
  write(pending_checkpoint_.offer({{}, core_.height() - 1, core_.hash(), core_.snapshot()}));
}

void Service::write(std::optional<fabric::Checkpoint> due) {
  if (blocks_ && due) blocks_->store(due->number, std::move(due->hash), std::move(due->records));
}

void Service::on_shared_confirmed(std::uint64_t number, const std::string& hash) {
  const auto lock = mutex_.lock_first();
  if (!readiness_.failed()) write(pending_checkpoint_.on_peer_block(number, hash));
}

void Service::fail(const std::string& why) {
  {
    const auto lock = mutex_.lock_first();
    if (readiness_.failed()) return;
    stop_signing();
  }
  report_failure(why);
}

void Service::stop_signing() {
  readiness_.fail();
  waiters_wake_.notify_all();
}

void Service::report_failure(const std::string& why) {
  spdlog::error("endorser: it signs nothing more: {}", why);
  on_failure_();
}

void Service::on_block(BlockSources::Source from, const fabric::Block& block, std::string_view raw) {
  Status taken = done;
  bool begins = false;
  {
    const auto lock = mutex_.lock_first();
    if (readiness_.failed() || first_state_) return;
    if (sources_.accepts(from, block.number, core_.height())) taken = core_.apply(block, raw);
    if (!taken) stop_signing();  // at once: the block may be half taken
    if (taken && blocks_ && blocks_->has_checkpoint_file() && block.confirmed)
      write(pending_checkpoint_.on_peer_block(
          block.number, fabric::block_header_hash(block.number, block.previous_hash, block.data_hash)));
    counts_.blocks = core_.height();
    if (sources_.try_join(core_.height())) {
      counts_.joined = true;
      begins = set_connected(true);
      checker_wakes_.notify_all();  // ends the own stream
    }
    waiters_wake_.notify_all();
  }
  if (begins) log_connection(true, "");
  if (!taken) report_failure(taken.error().message);
}

void Service::on_connection(BlockSources::Source from, bool connected, const std::string& why) {
  bool changes = false;
  {
    const auto lock = mutex_.lock_first();
    if (from == BlockSources::Source::shared) sources_.set_shared_connected(connected);
    changes = sources_.depends_on(from) && set_connected(connected);
  }
  if (changes) log_connection(connected, why);
}

bool Service::set_connected(bool connected) {
  if (readiness_.connected() == connected) return false;
  readiness_.on_connection(connected);
  checker_wakes_.notify_all();
  return true;
}

void Service::log_connection(bool connected, const std::string& why) {
  spdlog::info("endorser: {}", connected ? "follows the peer's blocks" : "clients are to ask the peer: " + why);
}

node::Reply Service::process_proposal(const std::string& signed_proposal, Caller caller) {
  Status renewed = done;
  node::Reply reply = process_locked(signed_proposal, caller, renewed);
  if (!renewed)
    spdlog::error("endorser: it goes on signing with its old certificate, the renewed one is refused: {}",
                  renewed.error().message);
  return reply;
}

node::Reply Service::process_locked(const std::string& signed_proposal, Caller caller, Status& renewed) {
  auto lock = caller == Caller::own ? mutex_.lock_first() : mutex_.lock_later();
  const auto send_to_the_peer = [&](const std::string& why) -> node::Reply {
    ++counts_.sent_to_the_peer;
    return {node::Code::unavailable, why, why, {}};
  };
  if (const Status ready = readiness_.check(core_.height()); !ready) return send_to_the_peer(ready.error().message);
  if (sources_.is_behind_reader(core_.height()))
    return send_to_the_peer("the endorser has not taken the newest blocks yet");
  renewed = apply_renewed_identity();
  node::Reply reply = core_.process_proposal(signed_proposal, {monotonic_ns(), realtime_ns()}, caller == Caller::own);
  if (reply.code == node::Code::unavailable) {
    ++counts_.sent_to_the_peer;
    return reply;
  }
  // Until it has agreed, one check at a time: a slow peer holds up the caller once a check, not at each proposal.
  const bool may_choose = has_agreed() || checks_.added() == checks_.over();
  const bool chosen = reply.code == node::Code::ok && may_choose && choose_for_check(signed_proposal, reply.bytes);
  // The client would ask the peer the same at the same time, which refuses one of two that have one id.
  if (chosen && !has_agreed()) await_check(lock);
  if (!has_agreed() || readiness_.failed())
    return send_to_the_peer("the endorser has not yet answered as the peer under this definition of the contract");
  ++counts_.answered;
  return reply;
}

Status Service::apply_renewed_identity() {
  auto now = identity_->now();
  if (now == last_identity_) return done;
  last_identity_ = std::move(now);
  return core_.renew(*last_identity_);
}

bool Service::choose_for_check(const std::string& signed_proposal, const std::string& answer) {
  if (has_agreed() && !checks_.draw()) return false;
  if (!checks_.add({signed_proposal, answer, core_.defined_at()})) {
    ++counts_.not_checked;
    return false;
  }
  checker_wakes_.notify_all();
  return true;
}

void Service::await_check(std::unique_lock<std::mutex>& lock) {
  waiters_wake_.wait_for(lock, max_wait_for_check,
                         [&, mine = checks_.added()] { return checks_.over() >= mine || stopping_; });
}

void Service::run_checks() {
  ::pthread_setname_np(::pthread_self(), "checks");
  BackOff back_off(first_retry_ns, max_retry_ns);
  auto checkpoint_at = std::chrono::steady_clock::now() + checkpoint_period;
  Random random(seed());
  auto lock = mutex_.lock_first();
  while (!stopping_) {
    if (first_state_) {
      if (begin_with_first_state(lock))
        back_off.succeeded();
      else
        checker_wakes_.wait_for(lock, std::chrono::nanoseconds(back_off.next(random)), [&] { return stopping_; });
    } else if (readiness_.needs_height()) {
      const std::uint64_t connection = readiness_.connection();
      lock.unlock();
      const auto height = peer_->height();
      if (!height) spdlog::warn("endorser: the peer does not say how many blocks it has: {}", height.error().message);
      lock.lock();
      if (connection != readiness_.connection()) {
        // It is of before.
      } else if (height) {
        readiness_.set_peer_height(connection, *height);
        back_off.succeeded();
        waiters_wake_.notify_all();
      } else {
        checker_wakes_.wait_for(lock, std::chrono::nanoseconds(back_off.next(random)), [&] { return stopping_; });
      }
    } else if (sources_.has_joined() && blocks_ && blocks_->is_open()) {
      lock.unlock();
      blocks_->close();
      client_.reset();
      lock.lock();
    } else if (auto one = checks_.next()) {
      lock.unlock();
      compare_with_peer(std::move(*one));
      lock.lock();
      checks_.ended();
      waiters_wake_.notify_all();
    } else {
      checker_wakes_.wait_until(lock, checkpoint_at);
    }
    if (std::chrono::steady_clock::now() < checkpoint_at) continue;
    store_checkpoint();
    checkpoint_at = std::chrono::steady_clock::now() + checkpoint_period;
  }
}

void Service::compare_with_peer(SampledChecks::Check one) {
  Comparison found = Comparison::other_state;
  for (int tried = 0; found == Comparison::other_state && tried < max_tries; ++tried) {
    if (tried > 0) {
      // One of the two had not taken a block yet: both once more.
      auto lock = mutex_.lock_first();
      checker_wakes_.wait_for(lock, again_after, [&] { return stopping_; });
      node::Reply reply = core_.process_proposal(one.signed_proposal, {monotonic_ns(), realtime_ns()});
      if (stopping_ || readiness_.failed() || !readiness_.connected() || reply.code != node::Code::ok) return;
      one.answer = std::move(reply.bytes);
      one.defined_at = core_.defined_at();
    }
    const auto peers = peer_->propose(one.signed_proposal);
    const auto lock = mutex_.lock_first();
    if (tried == 0) ++counts_.checked;
    if (!peers) {
      ++counts_.peer_refused;  // it has the transaction by now, or is not reached
      return;
    }
    found = compare_answers(one.answer, *peers);
    if (found == Comparison::other_state) ++counts_.other_state;
  }
  if (found == Comparison::other_state && peer_is_behind()) return;
  Status agrees = done;
  {
    const auto lock = mutex_.lock_first();
    if (found == Comparison::same) ++counts_.same;
    if (found == Comparison::differ) ++counts_.differ;
    if (found == Comparison::other_state) ++counts_.apart;
    agrees = readiness_.record_comparison(found, one.defined_at, core_.defined_at());
  }
  if (!agrees) fail(agrees.error().message);
}

/// By the orderers' blocks one may be ahead of the peer, by many where it is slow.
bool Service::peer_is_behind() {
  const auto height = peer_->height();
  const auto lock = mutex_.lock_first();
  return !height || *height < core_.height();
}

bool Service::wait_until_ready(double seconds) {
  auto lock = mutex_.lock_first();
  const auto ready = [&] { return readiness_.failed() || readiness_.check(core_.height()); };
  return waiters_wake_.wait_for(lock, std::chrono::duration<double>(seconds), ready) && !readiness_.failed();
}

Service::Counts Service::counts() const {
  const auto lock = mutex_.lock_first();
  return counts_;
}

Status write_summary(const std::string& path, const Service::Counts& counts) {
  const nlohmann::json summary{{"blocks", counts.blocks},
                               {"answered", counts.answered},
                               {"sent_to_the_peer", counts.sent_to_the_peer},
                               {"checked", counts.checked},
                               {"same", counts.same},
                               {"other_state", counts.other_state},
                               {"peer_refused", counts.peer_refused},
                               {"apart", counts.apart},
                               {"not_checked", counts.not_checked},
                               {"differ", counts.differ},
                               {"restored", counts.restored},
                               {"joined", counts.joined}};
  return write_file(path, summary.dump(2) + "\n");
}

}  // namespace ledgerline::endorser
