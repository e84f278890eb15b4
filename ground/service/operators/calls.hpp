#pragma once
#include <cstddef>
#include <cstdint>
#include <string>

#include "common/crypto/crypto.hpp"
#include "common/fabric/sending/outcome.hpp"

namespace ledgerline::ground::service {

/// What an operator signs beside stops: who flies one drone.
struct OperatorCall {
  enum class Kind {
    acquire,    ///< takes the lease
    release,    ///< gives it back
    request,    ///< asks its holder for it
    hand_over,  ///< gives it to one who has requested it
    deny,       ///< ends somebody's request, or his own
    resume      ///< lifts his own stop, or all as a supervisor of the drone's organisation
  };
  Kind kind = Kind::acquire;
  std::size_t drone = 0;       ///< index
  std::uint32_t priority = 0;  ///< of acquire and request
  crypto::IdentityName to{};   ///< of hand_over and deny
};

/// In words: "take control", ...
const char* words_of(OperatorCall::Kind kind);

/// The contract's call. `commander`: whose commands the drone shall obey under the operator's lease, the ground's own
/// identity. Pure.
fabric::Call contract_call(const OperatorCall& call, const std::string& drone, const crypto::IdentityName& commander);

}  // namespace ledgerline::ground::service
