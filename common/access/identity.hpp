#pragma once
#include <string>

#include "common/crypto/crypto.hpp"
#include "ledgerline.pb.h"

/// An identity's name, as the contract's messages and as certificates say it.
namespace ledgerline {

inline Identity to_message(const crypto::IdentityName& name) {
  Identity identity;
  identity.set_msp_id(name.msp_id);
  identity.set_subject(name.subject);
  return identity;
}
inline crypto::IdentityName to_name(const Identity& identity) { return {identity.msp_id(), identity.subject()}; }

/// "Org1MSP CN=User1@...".
inline std::string to_text(const Identity& identity) { return identity.msp_id() + " " + identity.subject(); }
inline std::string to_text(const crypto::IdentityName& name) { return name.msp_id + " " + name.subject; }

}  // namespace ledgerline
