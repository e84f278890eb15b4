#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "common/crypto/crypto.hpp"
#include "common/fabric/sending/outcome.hpp"
#include "common/fabric/tx/transaction.hpp"

namespace ledgerline::ground::service {

/// What an operator signs beside stops: who flies one drone, and that a mission may be flown.
struct OperatorCall {
  enum class Kind {
    acquire,     ///< takes the lease
    release,     ///< gives it back
    request,     ///< asks its holder for it
    hand_over,   ///< gives it to one who has requested it
    deny,        ///< ends somebody's request, or his own
    clear_stop,  ///< clears his own stop, ground's, or all as a supervisor of the drone's organisation
    approve,     ///< a mission: anchors what stands for it, here and now (ApprovalTerms)
    withdraw     ///< such an approval: anchors what ends it
  };
  Kind kind = Kind::acquire;
  std::optional<std::size_t> drone{};  ///< index; of all but approve and withdraw
  std::uint32_t priority = 0;          ///< of acquire and request
  bool ground_too = false;             ///< of clear_stop: ground, which alone has stopped it, clears that
  crypto::IdentityName to{};           ///< of hand_over and deny
  crypto::Digest digest{};             ///< of approve and withdraw
  std::string what{};                  ///< likewise: what it says on the ledger
  std::string mission{};               ///< likewise: its name
};

/// Anchors that digest with these words.
fabric::Call anchor_call(const crypto::Digest& digest, const std::string& what);

/// In words: "take control", ...
std::string words_of(const OperatorCall& call);

/// The contract's call. `drone`: its name. `commander`: whose commands the drone shall obey under the operator's lease,
/// the ground's own identity. Pure.
fabric::Call contract_call(const OperatorCall& call, const std::string& drone, const crypto::IdentityName& commander);

}  // namespace ledgerline::ground::service
