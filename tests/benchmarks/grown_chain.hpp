#pragma once
#include <cstdint>
#include <string>

#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/transaction.hpp"

/// A long chain of the embedded node's making, quickly: no network, one transaction a block. For benchmarks and system
/// tests; what goes wrong ends the program with a message.
namespace ledgerline::grown {

/// Below a node's directory.
inline constexpr const char* organisation = "/crypto/peerOrganizations/org1.ledgerline";

[[noreturn]] void give_up(const std::string& why);
fabric::Call state_of_a_drone();
/// Org1's User1, the drones' host.
crypto::SigningIdentity user_of(const std::string& dir);
/// Until the chain in `dir`, where no node runs, is so high; returns its height.
std::uint64_t grow(const std::string& dir, std::uint64_t height);

}  // namespace ledgerline::grown
