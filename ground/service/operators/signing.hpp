#pragma once
#include <string>

#include "common/fabric/sending/outcome.hpp"
#include "ground/core/flight_types.hpp"
#include "ground/service/operators/calls.hpp"

namespace ledgerline::ground::service {

/// Whose key an operator's call would be signed with, at that moment.
struct KeyState {
  bool unlocked = false;
  bool left = false;  ///< his session is over, and what he holds is being given back
};

/// Why a call that has waited for its turn is not signed; empty: it is. For one who has left nothing is signed but that
/// he gives back: what he asked for before would outlive him.
std::string not_signed(const KeyState& key, OperatorCall::Kind kind);

/// Whether ground clears its own stop of that drone behind an operator's clear_stop that ended so: the contract had
/// nothing of his to clear there. One whose role is revoked is refused as a whole, and clears nothing.
bool may_clear_ground_stop(const fabric::Outcome& outcome, const std::string& drone);

/// What people get to know of a call, as an event.
struct CallUpdate {
  ground::Level level = ground::Level::info;
  std::string words;
};
/// `why` it was not signed.
CallUpdate news_of(const std::string& name, const OperatorCall& call, const std::string& why);
/// What the ledger made of it.
CallUpdate news_of(const std::string& name, const OperatorCall& call, const fabric::Outcome& outcome);

}  // namespace ledgerline::ground::service
