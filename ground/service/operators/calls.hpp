#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "common/crypto/crypto.hpp"
#include "common/fabric/calls/outcome.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "ground/core/flight_types.hpp"

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

/// Whose key an operator's call would be signed with, at that moment.
struct OperatorKeyState {
  bool unlocked = false;
  bool left = false;  ///< his session is over, and what he holds is being given back
};

/// The error says why a call that has waited for its turn is not signed. For one who has left nothing is signed but
/// that he gives back: what he asked for before would outlive him.
Status check_key(const OperatorKeyState& key, OperatorCall::Kind kind);

/// Whether ground clears its own stop of that drone behind an operator's clear_stop that ended so: the contract had
/// nothing of his to clear there. One whose role is revoked is refused as a whole, and clears nothing.
bool may_clear_ground_stop(const fabric::Outcome& outcome, const std::string& drone);

/// What people get to know of a call, as an event.
struct CallUpdate {
  ground::Level level = ground::Level::info;
  std::string words;
};
/// `why` it was not signed.
CallUpdate update_of(const std::string& name, const OperatorCall& call, const std::string& why);
/// What the ledger made of it.
CallUpdate update_of(const std::string& name, const OperatorCall& call, const fabric::Outcome& outcome);

}  // namespace ledgerline::ground::service
