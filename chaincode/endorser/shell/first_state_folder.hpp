#pragma once
#include <string>

#include "chaincode/endorser/core/peer_snapshot.hpp"
#include "chaincode/endorser/shell/settings.hpp"

namespace ledgerline::endorser {

/// Reads the folder that first_state names. An error names folder and file, and says what to do.
Result<PeerSnapshot> read_first_state_folder(const FirstStateSettings& settings,
                                             const fabric::ChannelAndContract& where);

/// Why a snapshot is not taken, with what to do about it.
std::string refused_first_state(const std::string& why);

}  // namespace ledgerline::endorser
