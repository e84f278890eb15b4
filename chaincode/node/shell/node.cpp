#include "chaincode/node/shell/node.hpp"

#include <pthread.h>

#include <algorithm>
#include <filesystem>

#include "chaincode/identities/identities.hpp"
#include "chaincode/node/core/tx/messages.hpp"
#include "common/base/check.hpp"
#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/contract.hpp"
#include "msp/identities.pb.h"

namespace ledgerline::node {

namespace fs = std::filesystem;

namespace {

constexpr TimeNs slow_disk_ns = 100 * ns_per_ms;  // everybody waits that long: worth a line in the log
constexpr TimeNs full_disk_pause_ns = 100 * ns_per_ms;
constexpr TimeNs max_stay_ns = 2 * ns_per_ms;  // of two threads that read what comes: the other one may store a block

}  // namespace

std::string user_msp_dir(const std::string& dir, int organisation, const std::string& user) {
  return identities::user_dir(dir, organisation, user) / "msp";
}

Result<Identities> open_identities(const std::string& dir) {
  const fs::path crypto = fs::path(dir) / "crypto", blocks = fs::path(dir) / "ledger" / "blocks";
  std::error_code error;
  if (!fs::exists(crypto) && fs::exists(blocks) && fs::file_size(blocks, error) > 0) {
    return Error{crypto.string() + " is missing, but " + blocks.string() +
                 " holds blocks signed under it. Restore it from a copy, or begin in an empty directory"};
  }
  if (Status made = identities::make(dir, 1); !made) return made.error();
  Identities all;
  for (int number = 1; number <= identities::organisations; ++number) {
    const std::string msp_id = identities::msp_id_of(number);
    const auto ca = read_file(identities::organisation_dir(dir, number) / "ca" /
                              ("ca." + identities::domain_of(number) + "-cert.pem"));
    if (!ca) return ca.error();
    all.organisations.push_back({msp_id, *ca});
    const fs::path peer = identities::peer_dir(dir, number);
    auto identity = crypto::load_identity(crypto::Library::libcrypto, msp_id, peer / "msp");
    if (!identity) return identity.error();
    all.peers.push_back(std::move(*identity));
    const auto key = crypto::read_key_file(peer / "tls" / "server.key");
    const auto certificate = read_file(peer / "tls" / "server.crt");
    if (!key) return key.error();
    if (!certificate) return certificate.error();
    all.tls.push_back({*key, *certificate});
  }
  auto identity =
      crypto::load_identity(crypto::Library::libcrypto, "OrdererMSP", identities::orderer_dir(dir, 1) / "msp");
  if (!identity) return identity.error();
  all.orderer = std::move(*identity);
  const auto ca = read_file(identities::ordering_dir(dir) / "ca" / "ca.ledgerline-cert.pem");
  if (!ca) return ca.error();
  all.orderers = {"OrdererMSP", *ca};
  return all;
}

Result<std::unique_ptr<Node>> Node::open(Options options) {
  std::unique_ptr<Node> node(new Node(std::move(options)));
  const std::string& dir = node->options_.dir;
  auto files = open_directory(dir + "/ledger");
  if (!files) return files.error();
  node->files_ = std::move(*files);
  auto identities = open_identities(dir);
  if (!identities) return identities.error();
  node->identities_ = std::move(*identities);
  node->options_.core.organisations = node->identities_.organisations;
  node->options_.core.orderers = node->identities_.orderers;
  if (Status status = node->open_ledger(); !status) return status.error();
  if (Status status = node->write_config_block(); !status) return status.error();
  if (node->core_->height() < 1 + first_call_count) {
    // A new ledger, or one whose first start was cut short; what was called already changes nothing.
    if (Status status = node->enroll_first(); !status) return status.error();
  }
  node->feed_ = std::make_unique<BlockFeed>(*node->store_);
  node->feed_->start_at(node->store_->height());
  node->clock_ = std::thread([raw = node.get()] { raw->run_clock(); });
  return node;
}

Node::~Node() { stop(); }

Status Node::open_ledger() {
  std::shared_ptr<crypto::MspRegistry> registry =
      crypto::make_msp_registry(crypto::Library::libcrypto, identities_.organisations);
  core_ = std::make_unique<NodeCore>(options_.core, registry, identities_.peers, identities_.orderer,
                                     [this](std::uint64_t number) { return store_->read(number); });
  auto store = BlockStore::open(
      *files_, [this](std::string_view block) { return core_->replay(block); },
      [](const std::string& message) { spdlog::warn("{}", message); });
  if (!store) return store.error();
  store_ = std::move(*store);
  const std::string anchor = config_block_file();
  if (core_->height() == 0 && fs::exists(anchor))
    return Error{options_.dir + "/ledger/blocks has no block, though " + anchor +
                 " shows that there was a ledger: restore it from a copy; to begin a new ledger, use another folder"};
  if (core_->height() == 0) return commit_now(core_->genesis());
  spdlog::info("replayed {} blocks from {}", core_->height(), options_.dir);
  return done;
}

Status Node::write_config_block() {
  const auto block = store_->read(0);
  if (!block) return block.error();
  return replace_file(config_block_file(), *block);
}

Status Node::commit_now(const CutBlock& block) {
  if (Status status = store_->append(block.bytes); !status) return status;
  core_->apply(block);
  for (const TxStatus& status : block.transactions) {
    if (status.code != 0) return Error{"transaction " + status.tx_id + " is invalid: " + std::to_string(status.code)};
  }
  return done;
}

Status Node::submit_now(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg) {
  const fabric::ChannelAndContract where{options_.core.channel, options_.core.contract};
  const auto proposal = fabric::make_proposal(who, where, {function, {arg}}, realtime_ns(), crypto::random_bytes(24));
  if (!proposal) return proposal.error();
  const Reply endorsed = core_->endorse(proposal->signed_proposal, read_now());
  if (endorsed.code != Code::ok) return Error{function + ": " + endorsed.message + ": " + endorsed.detail};
  const auto envelope = fabric::sign_envelope(who, endorsed.bytes);
  if (!envelope) return envelope.error();
  const Reply ordered = core_->order(*envelope, read_now());
  if (ordered.code != Code::ok) return Error{function + ": " + ordered.message};
  Now late = read_now();
  late.monotonic_ns += options_.core.batch_timeout_ns;
  const auto block = core_->cut(late);
  if (!block) return Error{function + ": no block was cut"};
  return commit_now(*block);
}

Status Node::enroll_first() {
  int number = 0;
  for (const auto& organisation : identities_.organisations) {
    ++number;
    const auto load = [&](const char* who) {
      return crypto::load_identity(crypto::Library::libcrypto, organisation.msp_id,
                                   user_msp_dir(options_.dir, number, who));
    };
    const auto admin = load("Admin"), user = load("User1");
    if (!admin) return admin.error();
    if (!user) return user.error();
    for (const FirstCall& call : first_calls(number, user->name, options_.drones)) {
      if (Status s = submit_now(*admin, call.function, call.argument); !s) return s;
    }
  }
  return done;
}

Requester Node::requester_of(const std::string& serialized) const {
  msp::SerializedIdentity identity;
  if (!identity.ParseFromString(serialized)) return {};
  const auto is_its = [&](const crypto::MspRoot& one) { return one.msp_id == identity.mspid(); };
  if (std::ranges::none_of(options_.core.organisations, is_its)) return {};
  return {identity.mspid(), serialized};
}

Node::TaskPriority Node::priority_of(std::string_view signed_proposal) const {
  const auto read = read_signed_proposal(signed_proposal);
  if (!read) return {};
  const ProposalParts& proposal = read->proposal;
  const bool writes = proposal.contract == options_.core.contract && !contract::is_question(proposal.function);
  return {writes ? Turn::first : Turn::later, requester_of(proposal.signature_header.creator())};
}

Requester Node::sender_of(const common::Envelope& envelope) const {
  common::Payload payload;
  common::SignatureHeader header;
  if (!payload.ParseFromString(envelope.payload()) || !header.ParseFromString(payload.header().signature_header()))
    return {};
  return requester_of(header.creator());
}

bool Node::post(Task task, Turn turn, const Requester& requester, Stay stay) {
  Lock lock(mutex_);
  if (tasks_.is_full(turn) || stopping_) return false;
  tasks_.push(turn, requester, std::move(task));
  work(lock, stay);
  return true;
}

void Node::post_always(Task task, const Requester& requester) {
  Lock lock(mutex_);
  tasks_.push(Turn::first, requester, std::move(task));
  work(lock, Stay::briefly);
}

void Node::on_answer(std::function<void(std::uint64_t, const TxStatus&)> handler) {
  post_always([this, handler = std::move(handler)](NodeCore&) { on_answer_ = handler; });
}

void Node::on_failure(std::function<void(const std::string&)> handler) {
  const Lock lock(mutex_);
  on_failure_ = std::move(handler);
}

void Node::work(Lock& lock, Stay stay) {
  const bool briefly = stay == Stay::briefly;
  work(lock, briefly ? 0 : monotonic_ns() + max_stay_ns, !briefly);
  if (to_store_ || (!busy_ && has_work())) clock_wakes_.notify_one();
}

/// One step at least, where the core is free.
void Node::work(Lock& lock, TimeNs until_ns, bool stores) {
  while (!busy_ && has_work()) {
    busy_ = true;
    due_.reset();
    const std::optional<CutBlock> written = std::exchange(written_, std::nullopt);
    Task task;
    if (!tasks_.empty()) task = tasks_.pop();
    const bool may_cut = !failed_;
    lock.unlock();
    check_disk();
    if (written) apply(*written);
    if (task) std::exchange(task, nullptr)(*core_);
    auto block = may_cut ? core_->cut(read_now()) : std::nullopt;
    const auto due = may_cut ? core_->next_cut() : std::nullopt;
    const bool has_readers = feed_->has_news();
    lock.lock();
    busy_ = false;
    due_ = due;
    if (block) writing_ = true;
    // The clock waits for what is due, and does what this thread leaves behind while it is busy with a block.
    if (stopping_ || due || ((block || has_readers) && has_work())) clock_wakes_.notify_one();
    if (has_readers) {
      lock.unlock();
      feed_->wake_readers();
      lock.lock();
    }
    if (block && stores)
      store(lock, std::move(*block));
    else if (block)
      to_store_ = std::move(block);
    const bool has_stored = stores && written_;
    if (monotonic_ns() >= until_ns && !has_stored) return;
  }
}

/// What commands and stops need is kept for them before the disk is full for all.
void Node::check_disk() {
  const TimeNs now = monotonic_ns();
  if (now < check_disk_ns_) return;
  check_disk_ns_ = now + ns_per_s;
  const auto space = space_at(options_.dir);
  // A disk that cannot be queried cannot be written either: the error is reported where a block is written.
  if (!space) return;
  const bool nearly_full = space->available < std::min(options_.kept_bytes, space->capacity / 32);
  if (core_->set_nearly_full(nearly_full) == nearly_full) return;
  if (nearly_full) {
    spdlog::error("{} has {} kB left: commands, stops and control alone are ordered", options_.dir,
                  space->available / 1'000);
  } else {
    spdlog::warn("{} has room again: everything is ordered", options_.dir);
  }
}

/// Nothing is announced that is not on disk. What finds no room there the clock tries again.
void Node::store(Lock& lock, CutBlock block) {
  LEDGERLINE_CHECK(writing_ && !written_, "one block is in progress at most", block.number);
  const bool again = std::exchange(store_at_ns_, 0) != 0;
  lock.unlock();
  if (!block.warning.empty() && !again)
    spdlog::warn("block {} is without the orderer's signature: {}", block.number, block.warning);
  const TimeNs begin = monotonic_ns();
  const Status stored = store_->append(block.bytes);
  const TimeNs took = monotonic_ns() - begin;
  if (took > slow_disk_ns) spdlog::warn("the disk took {:.0f} ms for block {}", to_ms(took), block.number);
  lock.lock();
  if (!stored) clock_wakes_.notify_one();
  if (!stored && store_->full() && !stopping_) {
    if (!again)
      spdlog::error("block {} waits for room on the disk, and nothing is confirmed meanwhile: {}", block.number,
                    stored.error().message);
    to_store_ = std::move(block);
    store_at_ns_ = monotonic_ns() + full_disk_pause_ns;
    return;
  }
  writing_ = false;
  if (stored) {
    disk_.add(took);
    written_ = std::move(block);
    return;
  }
  // For the core the block stays in progress for ever.
  failed_ = true;
  spdlog::error("the ledger stops: {}", stored.error().message);
  if (on_failure_) on_failure_(stored.error().message);
}

void Node::run_clock() {
  ::pthread_setname_np(::pthread_self(), "clock");
  Lock lock(mutex_);
  for (;;) {
    const TimeNs now = monotonic_ns();
    if (to_store_ && (stopping_ || now >= store_at_ns_)) {
      store(lock, std::move(*std::exchange(to_store_, std::nullopt)));
    } else if (!busy_ && has_work()) {
      work(lock, now + max_stay_ns, true);
    } else if (stopping_ && !busy_ && !writing_) {
      return;
    } else {
      std::optional<TimeNs> until = due_;
      if (to_store_) until = std::min(until.value_or(store_at_ns_), store_at_ns_);
      if (until)
        clock_wakes_.wait_for(lock, std::chrono::nanoseconds(*until - now));
      else
        clock_wakes_.wait(lock);
    }
  }
}

void Node::apply(const CutBlock& block) {
  const std::vector<WaiterAnswer> answers = core_->apply(block);
  feed_->publish(block.number, block.bytes, block.writers);
  for (const WaiterAnswer& answer : answers) {
    if (on_answer_) on_answer_(answer.waiter, answer.status);
  }
}

void Node::stop() {
  {
    const Lock lock(mutex_);
    stopping_ = true;
    clock_wakes_.notify_one();
  }
  if (clock_.joinable()) clock_.join();
}

}  // namespace ledgerline::node
