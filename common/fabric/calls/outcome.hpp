#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "common/rt/clock.hpp"

namespace ledgerline::fabric {

/// The contract's own refusal: a retry would be refused again. Whatever else refuses a call (a peer, a relay, an
/// orderer) gives none, and may let the next one pass. Made once, with the outcome; nobody else reads an outcome's
/// message.
struct ContractRefusal {
  std::string about;  ///< the id or drone that the words begin with ("tello3: ..."); empty: the whole call
  std::string words;  ///< the contract's, without what the peer puts before them
};

/// Of the message with which a peer refused a call; none: that was not the contract.
inline std::optional<ContractRefusal> refusal_in(std::string_view message) {
  constexpr std::string_view introduction = "chaincode response 500, ";
  if (!message.starts_with(introduction)) return std::nullopt;
  message.remove_prefix(introduction.size());
  // What a peer of Fabric answers in the contract's stead when it cannot run it.
  if (message.starts_with("error in simulation")) return std::nullopt;
  // The contract of another version, on a channel that is being moved: the next one may know the function.
  if (message.starts_with("unknown function ")) return std::nullopt;
  const auto colon = message.find(':');  // no id has one
  return ContractRefusal{std::string(message.substr(0, colon == std::string_view::npos ? 0 : colon)),
                         std::string(message)};
}

/// The refusal is for this id alone, or for the drone or name that it is below: the rest of the call may go again.
inline bool names(const ContractRefusal& refusal, std::string_view id) {
  return !refusal.about.empty() && (refusal.about == id || refusal.about == id.substr(0, id.find('/')));
}

/// How a submitted call ended.
struct Outcome {
  enum class Kind {
    committed,    ///< in a block and valid
    invalidated,  ///< in a block, flagged invalid: `code` says why (11 = MVCC_READ_CONFLICT)
    refused,      ///< by the contract (then `refusal`), a peer or an orderer: `message` has the reason
    unavailable,  ///< ledger not reached, or no answer in time: it may still come
    overloaded,   ///< too many in flight: nothing was sent
  };
  Kind kind = Kind::unavailable;
  std::string tx_id;
  std::uint64_t block = 0;
  int code = 0;                            ///< as Transaction::code, where it is in a block; 0: valid
  std::string message;                     ///< for people
  std::optional<ContractRefusal> refusal;  ///< of the contract itself
  std::string answer;                      ///< the contract's bytes, where it answered
  std::string unheard;                     ///< peers that were asked to endorse and did not: for people; empty: none
  TimeNs ordered_after_ns = 0;             ///< from the submit to the orderer's acknowledgement; 0: not known
  TimeNs endorsed_ns = 0;                  ///< CLOCK_MONOTONIC, when it was endorsed and signed; 0: it was not
  TimeNs ordered_ns = 0;                   ///< when the orderer acknowledged it; 0: not known, or its block came first

  /// A call that ended without the ledger's verdict; of a refusal `message` is what the peer said.
  static Outcome failed(Kind kind, std::string message) {
    Outcome outcome;
    outcome.kind = kind;
    if (kind == Kind::refused) outcome.refusal = refusal_in(message);
    outcome.message = std::move(message);
    return outcome;
  }
};

/// In a block, but what it had read was written by another before it (MVCC_READ_CONFLICT or PHANTOM_READ_CONFLICT), or
/// a key that it writes got its policy in the same block. The latter is ENDORSEMENT_POLICY_FAILURE as well as too few
/// endorsements.
inline bool lost_to_another(const Outcome& outcome) {
  return outcome.kind == Outcome::Kind::invalidated && outcome.code >= 10 && outcome.code <= 12;
}

}  // namespace ledgerline::fabric
