#include "chaincode/node/core/committer.hpp"

#include <algorithm>
#include <set>

#include "peer/chaincode_event.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::node {
namespace {

/// An event that names another contract or transaction would reach readers under a false name. (Fabric looks at the
/// contract alone.)
bool own_event(const TransactionParts& transaction, const std::string& contract) {
  if (transaction.action.events().empty()) return true;
  protos::ChaincodeEvent event;
  return event.ParseFromString(transaction.action.events()) && event.chaincode_id() == contract &&
         event.tx_id() == transaction.channel_header.tx_id();
}

/// The network's settings may have changed since; its name may not.
bool configures(const common::Block& block, const std::string& channel) {
  common::Envelope envelope;
  common::Payload payload;
  common::ChannelHeader channel_header;
  return block.data().data_size() == 1 && envelope.ParseFromString(block.data().data(0)) &&
         payload.ParseFromString(envelope.payload()) &&
         channel_header.ParseFromString(payload.header().channel_header()) && channel_header.type() == common::CONFIG &&
         channel_header.channel_id() == channel;
}

}  // namespace

std::vector<fabric::Endorser> Committer::endorsers_of(const TransactionParts& transaction, Now now) const {
  std::vector<fabric::Endorser> found;
  std::set<std::string> known;
  for (const protos::Endorsement& endorsement : transaction.endorsements) {
    const bool peer = std::find(endorsers_.begin(), endorsers_.end(), endorsement.endorser()) != endorsers_.end();
    if (!peer || !known.insert(endorsement.endorser()).second) continue;
    const auto member = members_.check(endorsement.endorser(), transaction.response_payload + endorsement.endorser(),
                                       endorsement.signature(), now);
    if (member) found.push_back({(*member)->name.msp_id, true});
  }
  return found;
}

bool Committer::satisfies_policies(const kvrwset::KVRWSet& set, const std::vector<fabric::Endorser>& endorsers) const {
  std::set<std::string> keys, organisations;
  for (const kvrwset::KVWrite& write : set.writes()) keys.insert(write.key());
  for (const kvrwset::KVMetadataWrite& write : set.metadata_writes()) keys.insert(write.key());
  bool contract_policy = keys.empty();
  for (const std::string& key : keys) {
    if (new_policies_.contains(key)) return false;
    const State::Value* value = ledger_.state().find(key);
    if (value == nullptr || value->policy.empty()) {
      contract_policy = true;
    } else if (!fabric::satisfies(value->policy, endorsers)) {
      return false;
    }
  }
  if (!contract_policy) return true;
  for (const fabric::Endorser& endorser : endorsers) organisations.insert(endorser.msp_id);
  return organisations.size() > config_.organisations.size() / 2;
}

int Committer::validate_form(const TransactionParts& transaction, Now now, kvrwset::KVRWSet& set) {
  if (transaction.code != protos::VALID) return transaction.code;
  if (ledger_.state().find_tx(transaction.channel_header.tx_id())) return protos::DUPLICATE_TXID;
  if (transaction.action.chaincode_id().name() != config_.contract) return protos::INVALID_CHAINCODE;
  ContractSet contract_set = read_contract_set(transaction.action, config_.contract);
  if (contract_set.code != protos::VALID) return contract_set.code;
  if (!own_event(transaction, config_.contract)) return protos::INVALID_OTHER_REASON;
  if (!satisfies_policies(contract_set.set, endorsers_of(transaction, now))) return protos::ENDORSEMENT_POLICY_FAILURE;
  set = std::move(contract_set.set);
  // Also when it turns out to have read what has changed: Fabric judges endorsements first.
  for (const kvrwset::KVMetadataWrite& write : set.metadata_writes()) new_policies_.insert(write.key());
  return protos::VALID;
}

std::vector<TxStatus> Committer::validate_all(const common::Block& block, Now now, std::vector<Write>& writes) {
  const std::uint64_t number = block.header().number();
  Overlay overlay(ledger_.state());
  std::vector<TxStatus> statuses;
  std::set<std::string> ids;
  new_policies_.clear();
  for (const std::string& envelope : block.data().data()) {
    const TransactionParts transaction = read_transaction(envelope);
    kvrwset::KVRWSet set;
    int code = validate_form(transaction, now, set);
    // As in Fabric, a transaction that fails for what it read has used its id up, also within the block.
    if (code == protos::VALID && !ids.insert(transaction.channel_header.tx_id()).second) code = protos::DUPLICATE_TXID;
    if (code == protos::VALID) code = overlay.check(set);
    if (code == protos::VALID) {
      overlay.add(set);
      writes.push_back({{number, statuses.size()}, std::move(set)});
    }
    statuses.push_back({transaction.channel_header.tx_id(), number, code});
  }
  return statuses;
}

CutBlock Committer::validate(OrderedBlock ordered, Now now) {
  common::Block& block = ordered.block;
  CutBlock cut{block.header().number(), {}, {}, std::move(ordered.warning)};
  std::vector<Write> writes;
  if (cut.number == 0) {
    cut.transactions.push_back({"", 0, protos::VALID});  // the config block, which is the node's own
  } else {
    cut.transactions = validate_all(block, now, writes);
  }
  std::string flags;
  for (const TxStatus& status : cut.transactions) flags += static_cast<char>(status.code);
  block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, flags);
  cut.bytes = block.SerializeAsString();
  under_way_ = UnderWay{header_hash(block.header()), std::move(writes)};
  return cut;
}

Applied Committer::apply(const CutBlock& block) {
  Applied applied;
  applied.block = block.number;
  applied.transactions = block.transactions;
  for (const Write& write : under_way_->writes) {
    ledger_.state().write(write.set, write.version);
  }
  ledger_.add_block(std::move(under_way_->hash));
  under_way_.reset();
  ++counts_.blocks;
  for (const TxStatus& status : block.transactions) {
    if (status.tx_id.empty()) continue;
    ++counts_.transactions;
    if (status.code != protos::VALID) ++counts_.invalid;
    // Anyone can claim a wrong id: it must not keep the right transaction out.
    if (status.code != protos::BAD_PROPOSAL_TXID) ledger_.state().add_tx(status.tx_id, {status.block, status.code});
    const auto waiting = waiters_.find(status.tx_id);
    if (waiting == waiters_.end() || status.code == protos::BAD_PROPOSAL_TXID) continue;
    for (const std::uint64_t waiter : waiting->second) applied.answers.push_back({waiter, status});
    waiters_.erase(waiting);
  }
  return applied;
}

Status Committer::check_follows(const common::Block& block, const std::string& name) const {
  const ChainEnd& end = ledger_.end();
  if (block.header().number() != end.height) {
    return Error{name + " is missing: there is block " + std::to_string(block.header().number()) + " in its place"};
  }
  if (block.header().previous_hash() != end.hash) return Error{name + " does not follow the block before it"};
  if (block.header().data_hash() != data_hash(block.data())) return Error{name + ": its data does not match its hash"};
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
  const TransactionParts transaction = read_transaction(envelope);
  const std::string& tx_id = transaction.channel_header.tx_id();
  ++counts_.transactions;
  if (code != protos::VALID) ++counts_.invalid;
  if (!tx_id.empty() && code != protos::BAD_PROPOSAL_TXID) ledger_.state().add_tx(tx_id, {at.block, code});
  if (code != protos::VALID) return;
  const ContractSet writes = read_contract_set(transaction.action, config_.contract);
  ledger_.state().write(writes.set, at);
}

Status Committer::replay(std::string_view bytes) {
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
  ledger_.add_block(header_hash(block.header()));
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
