#include "chaincode/endorser/core/first_state.hpp"

#include <fmt/format.h>

#include <utility>

#include "chaincode/node/core/tx/block.hpp"
#include "common/fabric/tx/transaction.hpp"

namespace ledgerline::endorser {
namespace {

/// common.ConfigEnvelope of a block that configures its channel.
std::string config_in(const common::Block& block) {
  common::Envelope envelope;
  common::Payload payload;
  if (!fabric::is_config(block) || !envelope.ParseFromString(block.data().data(0)) ||
      !payload.ParseFromString(envelope.payload()))
    return {};
  return std::move(*payload.mutable_data());
}

/// A block of the chain whose data match its header.
Result<common::Block> fetch_whole(std::uint64_t number, const fabric::BlockValidator::Fetch& fetch) {
  auto block = fetch(number);
  if (!block) return block;
  if (const auto decoded = fabric::decode_block(block->SerializeAsString()); !decoded) return decoded.error();
  return block;
}

}  // namespace

Result<std::string> confirm(const PeerSnapshot& said, fabric::BlockValidator& validator,
                            const fabric::BlockValidator::Fetch& fetch) {
  const std::uint64_t last = said.end.height - 1;
  if (last < validator.config())
    return Error{
        fmt::format("its newest block, {}, is older than config_block, which is block {}", last, validator.config())};
  const auto newest = fetch_whole(last, fetch);
  if (!newest) return newest.error();
  if (newest->header().number() != last || node::header_hash(newest->header()) != said.end.hash)
    return Error{fmt::format("the peer has another block {} than the snapshot's newest: it is of another chain", last)};
  if (Status known = validator.catch_up(*newest, fetch); !known) return known.error();
  if (Status valid = validator.validate(*newest); !valid) return valid.error();
  const auto config = fetch_whole(validator.config(), fetch);
  if (!config) return config.error();
  if (Status valid = validator.validate(*config); !valid) return valid.error();
  if (said.config_block != validator.config() || said.config != config_in(*config))
    return Error{fmt::format("its configuration, of block {}, is not the channel's, of block {}", said.config_block,
                             validator.config())};
  return config->SerializeAsString();
}

}  // namespace ledgerline::endorser
