#include "chaincode/node/core/ledger/history.hpp"

#include <algorithm>

#include "chaincode/node/core/tx/proposal.hpp"

namespace ledgerline::node {

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
    const auto& time = transaction.channel_header.timestamp();
    constexpr std::int64_t max_s = 9'000'000'000;  // a client's word: beyond it nanoseconds would not fit
    const std::int64_t seconds = std::clamp<std::int64_t>(time.seconds(), -max_s, max_s);
    return chaincode::KeyVersion{transaction.channel_header.tx_id(), seconds * ns_per_s + time.nanos(), write.value()};
  }
  return Error{"transaction " + place + " does not write " + key};
}

}  // namespace ledgerline::node
