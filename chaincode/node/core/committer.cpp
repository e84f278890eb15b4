#include "chaincode/node/core/committer.hpp"

#include "chaincode/node/core/tx/messages.hpp"
#include "common/base/check.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/validation/transaction_validator.hpp"
#include "msp/identities.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::node {
namespace {

/// A majority of the organisations, each by one of its peers.
fabric::Policy majority_of(const std::vector<crypto::MspRoot>& organisations) {
  fabric::Policy policy;
  for (const crypto::MspRoot& one : organisations) policy.parts.push_back(fabric::peer_policy(one.msp_id));
  policy.needed = organisations.size() / 2 + 1;
  return policy;
}

/// The network's settings may have changed since; its name may not.
bool configures(const common::Block& block, const std::string& channel) {
  if (block.data().data_size() != 1) return false;
  const common::ChannelHeader header = fabric::read_form(block.data().data(0)).channel_header;
  return header.type() == common::CONFIG && header.channel_id() == channel;
}

std::string msp_of(const std::string& creator) {
  msp::SerializedIdentity identity;
  identity.ParseFromString(creator);
  return identity.mspid();
}

}  // namespace

Committer::Committer(const CoreConfig& config, std::shared_ptr<crypto::MspRegistry> members, Ledger& ledger)
    : config_(config),
      rules_{config.channel, false},
      members_(std::move(members)),
      view_(ledger.state(), config.contract, majority_of(config.organisations)),
      ledger_(ledger) {}

CutBlock Committer::validate(OrderedBlock ordered) {
  common::Block& block = ordered.block;
  CutBlock cut{
      .number = block.header().number(), .bytes = {}, .transactions = {}, .warning = std::move(ordered.warning)};
  std::vector<Write> writes;
  if (cut.number == 0) {
    cut.transactions.push_back({"", 0, protos::VALID});  // the config block, which is the node's own
  } else {
    for (fabric::TransactionVerdict& verdict : fabric::validate_transactions(block, view_, *members_, rules_)) {
      const Version at{cut.number, cut.transactions.size()};
      if (verdict.code == protos::VALID) {
        cut.writers.insert(verdict.creator_msp);
        writes.push_back({at, set_of(verdict.sets, config_.contract), std::move(verdict.creator_msp)});
      }
      cut.transactions.push_back({std::move(verdict.tx_id), cut.number, verdict.code});
    }
  }
  LEDGERLINE_CHECK(cut.transactions.size() == static_cast<std::size_t>(block.data().data_size()),
                   "each transaction of a block gets one verdict", cut.number, cut.transactions.size());
  LEDGERLINE_CHECK(!block_in_progress_, "a block is validated when the one before it was applied", cut.number);
  LEDGERLINE_CHECK(block.metadata().metadata_size() > common::TRANSACTIONS_FILTER, "a block has room for its flags",
                   cut.number);
  std::string flags;
  for (const TxStatus& status : cut.transactions) flags += static_cast<char>(status.code);
  block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, flags);
  cut.bytes = block.SerializeAsString();
  block_in_progress_ = BlockInProgress{fabric::header_hash(block.header()), std::move(writes)};
  return cut;
}

std::vector<WaiterAnswer> Committer::apply(const CutBlock& block) {
  LEDGERLINE_CHECK(block_in_progress_ && block.number == ledger_.height(),
                   "the block that was validated is the next one", block.number, ledger_.height());
  std::vector<WaiterAnswer> answers;
  for (const Write& write : block_in_progress_->writes) {
    ledger_.state().write(write.set, write.version, write.writer);
  }
  ledger_.add_block(std::move(block_in_progress_->hash));
  LEDGERLINE_CHECK(ledger_.height() == block.number + 1, "the ledger grows by the block", block.number);
  block_in_progress_.reset();
  ++counts_.blocks;
  for (const TxStatus& status : block.transactions) {
    if (status.tx_id.empty()) continue;
    ++counts_.transactions;
    if (status.code != protos::VALID) ++counts_.invalid;
    // Anyone can claim a wrong id: it must not keep the right transaction out.
    if (status.code != protos::BAD_PROPOSAL_TXID) ledger_.state().add_tx(status.tx_id, {status.block, status.code});
    const auto waiting = waiters_.find(status.tx_id);
    if (waiting == waiters_.end() || status.code == protos::BAD_PROPOSAL_TXID) continue;
    for (const std::uint64_t waiter : waiting->second) answers.push_back({waiter, status});
    waiters_.erase(waiting);
  }
  return answers;
}

Status Committer::check_follows(const common::Block& block, const std::string& name) const {
  const ChainEnd& end = ledger_.end();
  if (block.header().number() != end.height) {
    return Error{name + " is missing: there is block " + std::to_string(block.header().number()) + " in its place"};
  }
  if (block.header().previous_hash() != end.hash) return Error{name + " does not follow the block before it"};
  if (block.header().data_hash() != fabric::data_hash(block.data()))
    return Error{name + ": its data does not match its hash"};
  if (block.metadata().metadata_size() <= common::TRANSACTIONS_FILTER ||
      block.metadata().metadata(common::TRANSACTIONS_FILTER).size() !=
          static_cast<std::size_t>(block.data().data_size())) {
    return Error{name + " has no flags for its transactions"};
  }
  if (end.height == 0 && !configures(block, config_.channel)) {
    return Error{name + " is no config block of channel " + config_.channel};
  }
  return done;
}

void Committer::replay_transaction(std::string_view envelope, Version at, int code) {
  const fabric::TransactionForm transaction = fabric::read_form(envelope);
  const std::string& tx_id = transaction.channel_header.tx_id();
  ++counts_.transactions;
  if (code != protos::VALID) ++counts_.invalid;
  if (!tx_id.empty() && code != protos::BAD_PROPOSAL_TXID) ledger_.state().add_tx(tx_id, {at.block, code});
  if (code != protos::VALID) return;
  ledger_.state().write(set_of(fabric::read_sets(transaction.action.results()), config_.contract), at,
                        msp_of(transaction.signature_header.creator()));
}

Status Committer::replay(std::string_view bytes) {
  LEDGERLINE_CHECK(!block_in_progress_, "blocks from disk come before any that is made here", ledger_.height());
  common::Block block;
  const std::uint64_t number = ledger_.height();
  const std::string name = "block " + std::to_string(number);
  if (!block.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return Error{name + " does not parse"};
  if (Status s = check_follows(block, name); !s) return s;
  const std::string& flags = block.metadata().metadata(common::TRANSACTIONS_FILTER);
  for (int i = 0; i < block.data().data_size() && number > 0; ++i) {
    const auto tx = static_cast<std::size_t>(i);
    replay_transaction(block.data().data(i), {number, tx}, static_cast<unsigned char>(flags[tx]));
  }
  ledger_.add_block(fabric::header_hash(block.header()));
  ++counts_.blocks;
  return done;
}

std::optional<TxStatus> Committer::find(const std::string& tx_id) const {
  const auto known = ledger_.state().find_tx(tx_id);
  if (!known) return std::nullopt;
  return TxStatus{tx_id, known->block, known->code};
}

std::optional<TxStatus> Committer::watch(const std::string& tx_id, std::uint64_t waiter) {
  if (auto status = find(tx_id)) return status;
  waiters_[tx_id].push_back(waiter);
  return std::nullopt;
}

void Committer::unwatch(const std::string& tx_id, std::uint64_t waiter) {
  const auto waiting = waiters_.find(tx_id);
  if (waiting == waiters_.end()) return;
  std::erase(waiting->second, waiter);
  if (waiting->second.empty()) waiters_.erase(waiting);
}

}  // namespace ledgerline::node
