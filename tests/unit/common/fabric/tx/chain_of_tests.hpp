#pragma once
#include <string>
#include <vector>

#include "common/common.pb.h"
#include "common/fabric/tx/transaction.hpp"

/// Transactions and blocks as a peer would make them, for tests.
namespace ledgerline::fabric {

/// What these peers endorse for `proposal`: an unsigned common.Envelope whose contract answered `answer` and emitted
/// one event. Without peers: as a client makes it up, whose endorsements alone are missing.
common::Envelope endorse(const std::string& signed_proposal, const std::vector<crypto::SigningIdentity>& peers,
                         const std::string& answer, const std::string& event_name, const std::string& event_payload);

/// The function and arguments that a proposal calls.
Call call_of(const std::string& signed_proposal);
std::string tx_id_of(const common::Envelope& envelope);

/// Endorsed and signed.
std::string make_transaction(const crypto::SigningIdentity& client, const crypto::SigningIdentity& peer,
                             const Call& call, const std::string& nonce);

/// The same envelope with a result whose event names another transaction: one peer's key is enough for it, and Fabric
/// flags it valid. Nothing is signed again.
std::string with_foreign_event(const std::string& envelope);

/// Follows `previous` (nullptr: block 0); `flags` one byte per envelope, empty for a block as the orderer has it.
common::Block make_block(const common::Block* previous, const std::vector<std::string>& envelopes,
                         const std::string& flags);
/// Block 0 with a config transaction.
common::Block make_config_block(const std::string& channel);
/// Sets data hash, and previous hash as the header of `previous` has it.
void seal(common::Block& block, const common::Block* previous);

}  // namespace ledgerline::fabric
