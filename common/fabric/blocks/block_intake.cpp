#include "common/fabric/blocks/block_intake.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/base/check.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {
namespace {

constexpr TimeNs max_behind_ns = 2 * 3600 * ns_per_s;  // a clock that nobody set by time zone or summer

std::string not_as_ordered(std::uint64_t number) {
  return fmt::format("block {} of the peer is not the one that was ordered", number);
}

void set_flags(common::Block& message, const std::vector<TransactionVerdict>& verdicts) {
  std::string flags;
  for (const TransactionVerdict& verdict : verdicts) flags.push_back(static_cast<char>(verdict.code));
  while (message.metadata().metadata_size() <= common::TRANSACTIONS_FILTER)
    message.mutable_metadata()->add_metadata("");
  message.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, std::move(flags));
}

template <typename Kept>
void keep(std::map<std::uint64_t, Kept>& kept, std::uint64_t number, Kept one) {
  kept.insert_or_assign(number, std::move(one));
  if (kept.size() > ReportedHeaders::max_kept) kept.erase(kept.begin());
}

template <typename Kept>
std::optional<Kept> pop(std::map<std::uint64_t, Kept>& kept, std::uint64_t number) {
  auto node = kept.extract(number);
  return node.empty() ? std::nullopt : std::optional(std::move(node.mapped()));
}

}  // namespace

void ReportedHeaders::ordered(const common::Block& message, std::string hash) {
  Ordered one{std::move(hash), {}};
  *one.message.mutable_header() = message.header();
  // Of the metadata what is signed, and the signatures.
  const auto& metadata = message.metadata().metadata();
  if (metadata.size() > common::SIGNATURES && metadata[common::SIGNATURES].size() <= max_signatures_bytes)
    *one.message.mutable_metadata()->add_metadata() = metadata[common::SIGNATURES];
  keep(ordered_, message.header().number(), std::move(one));
}

void ReportedHeaders::forget_ordered() { ordered_.clear(); }

void ReportedHeaders::of_peer(std::uint64_t number, std::string hash) { keep(of_peer_, number, std::move(hash)); }

std::optional<ReportedHeaders::Ordered> ReportedHeaders::pop_ordered(std::uint64_t number) {
  return pop(ordered_, number);
}

std::optional<std::string> ReportedHeaders::pop_of_peer(std::uint64_t number) { return pop(of_peer_, number); }

void WaitingBlocks::add(common::Block message) {
  const std::size_t bytes = message.ByteSizeLong();
  if (blocks_.size() >= max_blocks || bytes_ + bytes > max_bytes) return;
  const std::uint64_t number = message.header().number();
  bytes_ += bytes;
  blocks_[number] = std::move(message);
}

std::optional<common::Block> WaitingBlocks::pop(std::uint64_t number) {
  std::optional<common::Block> out;
  const auto found = blocks_.find(number);
  if (found == blocks_.end()) return out;
  bytes_ -= found->second.ByteSizeLong();
  out = std::move(found->second);
  blocks_.erase(found);
  return out;
}

void WaitingBlocks::erase_up_to(std::uint64_t number) {
  while (!blocks_.empty() && blocks_.begin()->first <= number) (void)pop(blocks_.begin()->first);
}

Result<BlockIntake> BlockIntake::make(Setup setup) {
  BlockIntake intake(std::move(setup));
  if (intake.setup_.config_block.empty()) return intake;
  auto validator =
      BlockValidator::from(intake.setup_.config_block, intake.setup_.where.channel, intake.setup_.make_registry);
  if (!validator) return validator.error();
  intake.validator_ = std::move(*validator);
  intake.rules_.channel = intake.setup_.where.channel;
  intake.forget();
  return intake;
}

/// Blocks are missing: what was followed up to there says nothing of what comes.
void BlockIntake::forget() {
  if (!validator_) return;
  state_.emplace(KeyState::Part{.contract = setup_.where.contract, .rules = setup_.contract_rules});
  defined_ = false;
  configure();
}

void BlockIntake::configure() {
  const ChannelConfig& config = validator_->channel_config();
  configured_ = config.block;
  members_ = validator_->make_members();
  rules_.foreign_events = !config.embedded_node;
  state_->configure(config);
  if (!config.embedded_node) return;
  state_->define(setup_.where.contract);
  defined_ = true;
}

void BlockIntake::define(const std::string& policy) {
  if (!misses_definition()) return;
  state_->set_unverified_policy(setup_.where.contract, policy);
  defined_ = true;
}

Result<Continuation> BlockIntake::continue_chain(const LastVerified& verified, const common::Block& newest,
                                                 const Fetch& fetch) {
  auto on = continue_behind(verified, newest, fetch);
  if (!on) return on;
  caught_up_ = false;
  if (on->gap) {
    if (const Status valid = validate_block(newest, fetch); !valid) return valid.error();
    forget();
  }
  chain_ = on->chain;
  next_ = chain_.height();
  return on;
}

Status BlockIntake::validate_block(const common::Block& message, const Fetch& fetch) {
  if (!validator_) return done;
  if (!std::exchange(caught_up_, true)) {
    if (auto caught_up = validator_->catch_up(message, fetch); !caught_up) return caught_up;
  }
  return validator_->validate(message);
}

Result<Block> BlockIntake::add(const common::Block& message, const Fetch& fetch) {
  if (const Status status = consistent(); !status) return status.error();
  auto block = decode_block(message);
  if (!block) return block;
  // Its place first: a configuration out of its turn, which the orderers have signed as well, is not to be followed.
  if (next_ && block->number != *next_)
    return Error{fmt::format("block {} came where {} was due", block->number, *next_)};
  ChainCheck chain = chain_;
  if (Status follows = chain.add(*block); !follows) return follows.error();
  if (Status valid = validate_block(message, fetch); !valid) return valid.error();
  if (Status same = compare_with_ordered(block->number, chain.hash()); !same) return same.error();
  waiting_.erase_up_to(block->number);
  next_is_uncertain_ = false;
  chain_ = std::move(chain);
  next_ = chain_.height();
  if (state_) validate_transactions(message, *block);
  return block;
}

Error BlockIntake::contradict(std::string what) {
  contradiction_ = std::move(what);
  return Error{*contradiction_};
}

Status BlockIntake::consistent() const { return contradiction_ ? Status(Error{*contradiction_}) : done; }

bool BlockIntake::is_signed(const common::Block& message) { return !validator_ || validator_->is_signed(message); }

/// Of a block that the peer delivers.
Status BlockIntake::compare_with_ordered(std::uint64_t number, const std::string& hash) {
  if (setup_.source == BlockSource::peer) return done;
  const auto ordered = reported_.pop_ordered(number);
  if (!ordered) {
    reported_.of_peer(number, hash);
  } else if (ordered->hash != hash && is_signed(ordered->message)) {
    return contradict(not_as_ordered(number));
  } else if (ordered->hash != hash) {
    orderer_problem_ = fmt::format("block {} of an orderer is not the peer's, and not signed", number);
  }
  return done;
}

/// Of a block that an orderer delivers after the peer.
Status BlockIntake::compare_with_taken(const common::Block& message, const std::string& hash) {
  const std::uint64_t number = message.header().number();
  const auto taken = reported_.pop_of_peer(number);
  if (!taken || *taken == hash) return done;
  if (is_signed(message)) return contradict(not_as_ordered(number));
  return Error{fmt::format("block {} of an orderer is not the peer's, and not signed", number)};
}

Result<std::size_t> BlockIntake::confirm(const common::Block& message) {
  if (const Status status = consistent(); !status) return status.error();
  if (unconfirmed_.empty()) return Error{"no block waits to be confirmed"};
  auto& [number, ours] = *unconfirmed_.begin();
  if (message.header().number() != number)
    return Error{fmt::format("block {} came where {} was due", message.header().number(), number)};
  if (header_hash(message.header()) != ours.hash) {
    if (!is_signed(message)) return Error{not_as_ordered(number) + ", and not signed"};
    return contradict(not_as_ordered(number));
  }
  const std::string_view flags = flags_of(message);
  std::size_t reported_again = 0;
  for (std::size_t i = 0; i < ours.sets.size(); ++i) {
    const int flag = i < flags.size() ? static_cast<unsigned char>(flags[i]) : -1;
    if (flag == protos::VALID) continue;
    if (flag != protos::DUPLICATE_TXID)
      return contradict(fmt::format("block {}: the peer does not flag transaction {} valid, as we have found it ({})",
                                    number, i, flag));
    state_->forget(ours.sets[i]);
    ++reported_again;
  }
  ++counts_.confirmed;
  unconfirmed_.erase(unconfirmed_.begin());
  return reported_again;
}

std::optional<std::uint64_t> BlockIntake::begin_ordered() {
  next_ordered_.reset();
  orderer_problem_.reset();
  reported_.forget_ordered();
  waiting_ = {};
  if (setup_.source != BlockSource::peer) next_ordered_ = next_;
  return next_ordered_;
}

Status BlockIntake::add_ordered(common::Block message) {
  if (const Status status = consistent(); !status) return status.error();
  const std::uint64_t number = message.header().number();
  if (number != next_ordered_)
    return Error{fmt::format("an orderer sent block {} where {} was due", number, next_ordered_.value_or(0))};
  *next_ordered_ += 1;
  // An orderer's block has no flags; what it says in their place is nobody's word.
  if (!flags_of(message).empty()) message.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, "");
  std::string hash = header_hash(message.header());
  if (next_ && number < *next_) return compare_with_taken(message, hash);
  reported_.ordered(message, std::move(hash));
  waiting_.add(std::move(message));
  return done;
}

bool BlockIntake::can_take_ordered() const {
  return state_ && caught_up_ && next_ && *next_ != 0 && !next_is_uncertain_ && unconfirmed_.size() < max_unconfirmed;
}

Result<std::optional<BlockIntake::Ordered>> BlockIntake::pop_ordered() {
  if (const Status status = consistent(); !status) return status.error();
  std::optional<Ordered> none;
  if (!can_take_ordered()) return none;
  const std::uint64_t number = *next_;
  auto waiting = waiting_.pop(number);
  if (!waiting) return none;
  Ordered out;
  out.message = std::move(*waiting);
  waiting_.erase_up_to(number);
  next_is_uncertain_ = is_config(out.message);  // the peer's word decides, and is waited for
  if (next_is_uncertain_) return none;
  ChainCheck chain = chain_;
  if (Status follows = validate_ordered(out.message, chain); !follows) {
    (void)reported_.pop_ordered(number);
    return follows.error();
  }
  const std::vector<TransactionVerdict> verdicts =
      fabric::validate_transactions(out.message, *state_, *members_, rules_);
  next_is_uncertain_ = !std::all_of(verdicts.begin(), verdicts.end(), [](const TransactionVerdict& verdict) {
    return verdict.code == protos::VALID && verdict.repeatable && !verdict.by_flag;
  });
  if (next_is_uncertain_) {
    ++counts_.uncertain;
    return none;
  }
  (void)reported_.pop_ordered(number);
  set_flags(out.message, verdicts);
  auto block = decode_block(out.message);
  if (!block) return block.error();
  out.block = std::move(*block);
  out.block.confirmed = false;
  Unconfirmed& unconfirmed = unconfirmed_[number];
  unconfirmed.hash = chain.hash();
  for (const TransactionVerdict& verdict : verdicts) unconfirmed.sets.push_back(verdict.sets);
  chain_ = std::move(chain);
  next_ = chain_.height();
  apply_verdicts(verdicts, out.block);
  ++counts_.ordered_first;
  return std::optional(std::move(out));
}

/// That it is the next block, and signed. Before its transactions are looked at: anybody can make up some.
Status BlockIntake::validate_ordered(const common::Block& message, ChainCheck& chain) {
  if (Status valid = validator_->validate(message); !valid) return valid;
  const auto block = decode_block(message);
  return block ? chain.add(*block) : Status(block.error());
}

/// Since when ids are known, by creators' clocks: this machine's may be far behind theirs.
std::optional<TimeNs> BlockIntake::came_ns(const Block& block) const {
  if (!setup_.real_time) return std::nullopt;
  const TimeNs now_ns = setup_.real_time();
  TimeNs newest_ns = now_ns;
  for (const Transaction& transaction : block.transactions) {
    const bool plausible = transaction.code == protos::VALID && transaction.timestamp_ns < now_ns + max_behind_ns;
    if (plausible) newest_ns = std::max(newest_ns, transaction.timestamp_ns);
  }
  return newest_ns;
}

void BlockIntake::validate_transactions(const common::Block& message, Block& block) {
  if (validator_->config_block_number() != configured_ && validator_->config_block_number() != block.number)
    configure();
  // Nobody orders the first block.
  if (block.number == 0) return;
  apply_verdicts(fabric::validate_transactions(message, *state_, *members_, rules_), block);
  if (validator_->config_block_number() != configured_) configure();
}

void BlockIntake::apply_verdicts(const std::vector<TransactionVerdict>& verdicts, Block& block) {
  LEDGERLINE_CHECK(verdicts.size() == block.transactions.size(), "each transaction has a verdict", verdicts.size(),
                   block.transactions.size());
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    const TransactionVerdict& verdict = verdicts[i];
    Transaction& transaction = block.transactions[i];
    if (verdict.config) continue;
    if (verdict.by_flag) {
      ++counts_.by_flag;
    } else {
      ++counts_.validated;
    }
    const bool reported_again = transaction.code == protos::DUPLICATE_TXID && verdict.code != protos::DUPLICATE_TXID;
    transaction.by_flag = verdict.by_flag || reported_again;
    transaction.signature_verified = verdict.signature_verified;
    for (std::size_t e = 0; e < verdict.endorsements_verified.size() && e < transaction.endorsements.size(); ++e)
      transaction.endorsements[e].signature_verified = verdict.endorsements_verified[e];
    if (transaction.code == code_unverified) continue;
    // Of what is invalid in any case the reason makes no difference.
    const bool valid = verdict.code == protos::VALID;
    if (transaction.code >= 0 && valid == (transaction.code == protos::VALID)) continue;
    ++counts_.differ;
    if (transaction.code == protos::VALID) {
      const bool again = verdict.code == protos::DUPLICATE_TXID;
      transaction.code = again ? protos::DUPLICATE_TXID : code_unverified;
      transaction.problem = verdict.why;
    } else if (transaction.code < 0) {
      transaction.problem = "the peer does not say whether it is";
    } else {
      transaction.problem = "it is valid";
    }
  }
  state_->apply(block.number, verdicts, came_ns(block));
}

}  // namespace ledgerline::fabric
