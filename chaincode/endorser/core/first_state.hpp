#pragma once
#include <string>

#include "chaincode/endorser/core/peer_snapshot.hpp"
#include "common/fabric/validation/block_validator.hpp"

namespace ledgerline::endorser {

/// Whether an endorser may begin with a peer's snapshot in place of all blocks up to it: its newest block must be in
/// the chain that `fetch` brings, and signed by the channel's orderers, by the configurations from the trust anchor on,
/// which `validator` knows. Gives the newest of these that the snapshot can have, common.Block: nothing of a
/// configuration is the snapshot's word. What the contract's keys hold is. An error says what is not so, or which block
/// did not come. Pure.
Result<std::string> confirm(const PeerSnapshot& said, fabric::BlockValidator& validator,
                            const fabric::BlockValidator::Fetch& fetch);

}  // namespace ledgerline::endorser
