#include "chaincode/node/core/core.hpp"

#include <algorithm>

#include "chaincode/node/core/core_parts.hpp"
#include "peer/transaction.pb.h"

namespace ledgerline::node {

NodeCore::NodeCore(CoreConfig config, std::shared_ptr<crypto::MspRegistry> registry,
                   std::vector<crypto::SigningIdentity> peers, crypto::SigningIdentity orderer, ReadBlock read_block)
    : parts_(std::make_unique<Parts>()) {
  parts_->config = std::move(config);
  parts_->registry = std::move(registry);
  parts_->peers = std::move(peers);
  parts_->orderer = std::move(orderer);
  parts_->read_block = std::move(read_block);
  parts_->read_version = [parts = parts_.get()](const std::string& key, Version version) {
    return parts->version_of(key, version);
  };
}

NodeCore::~NodeCore() = default;

std::uint64_t NodeCore::height() const { return parts_->height; }
NodeCore::Counts NodeCore::counts() const { return parts_->counts; }

Result<common::Block> NodeCore::Parts::block_at(std::uint64_t number) const {
  auto bytes = read_block(number);
  if (!bytes) return bytes.error();
  common::Block block;
  if (!block.ParseFromString(*bytes)) return Error{"block " + std::to_string(number) + " is damaged"};
  return block;
}

Result<chaincode::KeyVersion> NodeCore::Parts::version_of(const std::string& key, Version version) {
  if (!history_block || history_block->header().number() != version.block) {
    auto block = block_at(version.block);
    if (!block) return block.error();
    history_block = std::move(*block);
  }
  const std::string place = std::to_string(version.tx) + " of block " + std::to_string(version.block);
  if (version.tx >= static_cast<std::uint64_t>(history_block->data().data_size())) {
    return Error{"there is no transaction " + place};
  }
  const TransactionParts transaction = read_transaction(history_block->data().data(static_cast<int>(version.tx)));
  const ContractSet writes = read_contract_set(transaction.action, config.contract);
  for (const kvrwset::KVWrite& write : writes.set.writes()) {
    if (write.key() != key) continue;
    const auto& time = transaction.channel_header.timestamp();
    constexpr std::int64_t max_s = 9'000'000'000;  // a client's word: beyond it nanoseconds would not fit
    const std::int64_t seconds = std::clamp<std::int64_t>(time.seconds(), -max_s, max_s);
    return chaincode::KeyVersion{transaction.channel_header.tx_id(), seconds * ns_per_s + time.nanos(), write.value()};
  }
  return Error{"transaction " + place + " does not write " + key};
}

Status NodeCore::replay(std::string_view bytes) {
  Parts& parts = *parts_;
  common::Block block;
  const std::string name = "block " + std::to_string(parts.height);
  if (!block.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return Error{name + " does not parse"};
  if (block.header().number() != parts.height) {
    return Error{name + " is missing: there is block " + std::to_string(block.header().number()) + " in its place"};
  }
  if (block.header().previous_hash() != parts.last_hash) return Error{name + " does not follow the block before it"};
  if (block.header().data_hash() != data_hash(block.data())) return Error{name + ": its data does not match its hash"};
  if (block.metadata().metadata_size() <= common::TRANSACTIONS_FILTER ||
      block.metadata().metadata(common::TRANSACTIONS_FILTER).size() !=
          static_cast<std::size_t>(block.data().data_size())) {
    return Error{name + " has no flags for its transactions"};
  }
  const std::string& flags = block.metadata().metadata(common::TRANSACTIONS_FILTER);
  if (parts.height == 0) {
    // The network's settings may have changed since; its name may not.
    common::Envelope envelope;
    common::Payload payload;
    common::ChannelHeader channel_header;
    if (block.data().data_size() != 1 || !envelope.ParseFromString(block.data().data(0)) ||
        !payload.ParseFromString(envelope.payload()) ||
        !channel_header.ParseFromString(payload.header().channel_header()) || channel_header.type() != common::CONFIG ||
        channel_header.channel_id() != parts.config.channel) {
      return Error{name + " is no config block of channel " + parts.config.channel};
    }
  }
  for (int i = 0; i < block.data().data_size() && parts.height > 0; ++i) {
    const int code = static_cast<unsigned char>(flags[static_cast<std::size_t>(i)]);
    const TransactionParts transaction = read_transaction(block.data().data(i));
    const std::string& tx_id = transaction.channel_header.tx_id();
    ++parts.counts.transactions;
    if (code != protos::VALID) ++parts.counts.invalid;
    if (!tx_id.empty() && code != protos::BAD_PROPOSAL_TXID) parts.state.add_tx(tx_id, {parts.height, code});
    if (code != protos::VALID) continue;
    const ContractSet writes = read_contract_set(transaction.action, parts.config.contract);
    for (const kvrwset::KVWrite& write : writes.set.writes()) {
      parts.state.write(write, {parts.height, static_cast<std::uint64_t>(i)});
    }
  }
  parts.last_hash = header_hash(block.header());
  ++parts.height;
  ++parts.counts.blocks;
  return done;
}

Result<crypto::IdentityName> NodeCore::check_signer(std::string_view serialized, std::string_view message,
                                                    std::string_view signature, Now now) {
  const auto member = parts_->check(serialized, message, signature, now);
  if (!member) return member.error();
  return (*member)->name;
}

std::optional<TxStatus> NodeCore::find(const std::string& tx_id) const {
  const auto known = parts_->state.find_tx(tx_id);
  if (!known) return std::nullopt;
  return TxStatus{tx_id, known->block, known->code};
}

std::optional<TxStatus> NodeCore::watch(const std::string& tx_id, std::uint64_t waiter) {
  if (auto status = find(tx_id)) return status;
  parts_->waiters[tx_id].push_back(waiter);
  return std::nullopt;
}

void NodeCore::unwatch(const std::string& tx_id, std::uint64_t waiter) {
  const auto waiting = parts_->waiters.find(tx_id);
  if (waiting == parts_->waiters.end()) return;
  std::erase(waiting->second, waiter);
  if (waiting->second.empty()) parts_->waiters.erase(waiting);
}

}  // namespace ledgerline::node
