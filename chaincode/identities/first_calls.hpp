#pragma once
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"

namespace ledgerline {

/// A call of the contract.
struct FirstCall {
  const char* function;
  std::string argument;
};

/// What an organisation's administrator calls on a new ledger of our own, embedded or Fabric, of three organisations:
/// Org1's User1 is the host of tello1 to tello16, which are granted to Org2 without a bound; Org2's User1 is an
/// operator. Each may be called again. `organisation` counts from 1, `user` is its User1.
std::vector<FirstCall> first_calls(int organisation, const crypto::IdentityName& user);
/// How many there are, of all organisations.
inline constexpr std::size_t first_call_count = 3;

}  // namespace ledgerline
