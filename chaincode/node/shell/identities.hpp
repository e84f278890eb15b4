#pragma once
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::node {

/// What the node needs of the identities under DIR/crypto.
struct Identities {
  std::vector<crypto::MspRoot> organisations;  ///< Org1MSP..Org3MSP with their certificate authorities
  std::vector<crypto::SigningIdentity> peers;  ///< one for each
  crypto::SigningIdentity orderer;
  crypto::MspRoot orderers;  ///< its organisation
  struct Tls {
    std::string key_pem, certificate_pem;
  };
  std::vector<Tls> tls;  ///< of each peer
};

/// Loads them; makes them first when DIR/crypto is missing (chaincode/identities).
Result<Identities> open_identities(const std::string& dir);

/// A user's msp folder: user_msp_dir(DIR, 2, "User1").
std::string user_msp_dir(const std::string& dir, int organisation, const std::string& user);

}  // namespace ledgerline::node
