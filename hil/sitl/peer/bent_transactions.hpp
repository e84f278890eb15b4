#pragma once
#include <cstdint>
#include <string>

#include "common/crypto/crypto.hpp"

/// What somebody with a peer's key can make of transactions, and of what is beside them in a block.
namespace ledgerline::hil {

/// A message of bytes that are one; of others what could be read.
template <typename Message>
Message parsed(const std::string& bytes) {
  Message message;
  message.ParseFromString(bytes);
  return message;
}

/// Of a common.Envelope: the function that its creator called; empty: it is no call.
std::string called_function(const std::string& envelope);

/// In a command: faster, no matter who signed it.
void bend_plan(std::string& envelope);
void break_creator(std::string& envelope);
/// By this peer alone; null: by nobody.
void endorse_by(std::string& envelope, const crypto::SigningIdentity* peer);
void name_channel(std::string& envelope, const std::string& channel);

/// Whole transactions that the peer signs as their creator and endorses. `number` makes them different.
std::string own_stop(const crypto::SigningIdentity& peer, std::uint64_t number);
/// Of a command that was signed by another.
std::string own_command(const crypto::SigningIdentity& peer, const std::string& envelope, std::uint64_t number);
/// A configuration in which the peer's organisation orders; `authority`: that organisation's certificate.
std::string own_config(const crypto::SigningIdentity& peer, const std::string& authority);

/// In a common.Metadata of block signatures: that the newest configuration is that block's.
void name_config(std::string& signatures, std::uint64_t number);

}  // namespace ledgerline::hil
