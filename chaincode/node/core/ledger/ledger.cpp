#include "chaincode/node/core/ledger/ledger.hpp"

namespace ledgerline::node {

Result<common::Block> Ledger::block_at(std::uint64_t number) const {
  auto bytes = read_block_(number);
  if (!bytes) return bytes.error();
  common::Block block;
  if (!block.ParseFromString(*bytes)) return Error{"block " + std::to_string(number) + " is damaged"};
  return block;
}

}  // namespace ledgerline::node
