#pragma once
#include "chaincode/network/options.hpp"
#include "common/base/result.hpp"

namespace ledgerline::fabric_network {

/// Brings the network that runs in options.dir, or this host's part of it, to options.chaincode, the contract of this
/// version, while it serves: its organisations approve the next definition, the host of the first one commits it, and
/// then the chaincode services end, to be started again by the network's process from the program that has taken the
/// place of theirs. Where all is done already it does nothing. Must be called on the thread that outlives
/// all others (Children).
Status upgrade(Options options);

}  // namespace ledgerline::fabric_network
