#include "chaincode/node/core/ledger/ledger.hpp"

#include "chaincode/node/core/tx/messages.hpp"
#include "common/base/check.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/form.hpp"

namespace ledgerline::node {

void Ledger::add_block(std::string hash) {
  LEDGERLINE_CHECK(hash.size() == std::tuple_size_v<crypto::Digest>, "the next block is to follow this hash",
                   end_.height, hash.size());
  end_ = {end_.height + 1, std::move(hash)};
}

Result<common::Block> Ledger::block_at(std::uint64_t number) const {
  auto bytes = read_block_(number);
  if (!bytes) return bytes.error();
  common::Block block;
  if (!block.ParseFromString(*bytes)) return Error{"block " + std::to_string(number) + " is damaged"};
  return block;
}

Result<chaincode::KeyVersion> History::version_of(const std::string& key, Version version) {
  if (!block_ || block_->header().number() != version.block) {
    auto block = ledger_.block_at(version.block);
    if (!block) return block.error();
    block_ = std::move(*block);
  }
  const std::string place = std::to_string(version.tx) + " of block " + std::to_string(version.block);
  if (version.tx >= static_cast<std::uint64_t>(block_->data().data_size())) {
    return Error{"there is no transaction " + place};
  }
  const fabric::TransactionForm transaction = fabric::read_form(block_->data().data(static_cast<int>(version.tx)));
  const kvrwset::KVRWSet set = set_of(fabric::read_sets(transaction.action.results()), contract_);
  for (const kvrwset::KVWrite& write : set.writes()) {
    if (write.key() != key) continue;
    return chaincode::KeyVersion{transaction.channel_header.tx_id(),
                                 fabric::time_of(transaction.channel_header.timestamp()), write.value()};
  }
  return Error{"transaction " + place + " does not write " + key};
}

}  // namespace ledgerline::node
