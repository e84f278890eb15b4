#pragma once
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/onboard.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::fabric {
class Client;
struct ClientConfig;
struct Outcome;
struct RepeatLimits;
}  // namespace ledgerline::fabric

/// What may be trusted of a transaction of the contract without trusting the peer that ran it. A peer signs results;
/// only the creator signs what was asked for. So what is done in a creator's name must be what that creator asked for,
/// and an event is no more than the peer's copy of it. Pure, but for submit_claiming().
namespace ledgerline::verification {

/// What a creator asked for: of a received transaction (its reader checks the creator's signature), or of one that is
/// about to be signed.
struct RequestedCall {
  std::string_view function;
  const std::vector<std::string>& args;
};

enum class Match {
  same,       ///< the event is the call
  altered,    ///< the event says something else than the call, or the call is of another function
  malformed,  ///< the event is the call, but that is no message of its function
};

/// Compares a call of `command` or `set` with the event of that name: byte for byte, or, where JSON or another order of
/// fields makes bytes differ, as the messages that they are. `asked` is the call as it was signed: what is flown or
/// shown comes from there. It is empty unless the call was of that function. An event of `set` that is empty, as a
/// stream's is, leaves it to the call.
Match match_command(const RequestedCall& call, std::string_view event_payload, CommandCall& asked);
Match match_set(const RequestedCall& call, std::string_view event_payload, SetCall& asked);
/// Whether the event says what a call of `set` asked for, message or not: who reads its bytes finds that out.
bool reports_set(const RequestedCall& call, std::string_view event_payload);

/// A plan as link takes it; of one that has at most max_setpoints.
Plan plan_of(DroneNumber drone, const DronePlan& asked);

/// For clients, before they sign: why a result with this event (no name: none) cannot be the contract's of this call.
/// Functions that the contract does not have are not checked.
Status check_event(const RequestedCall& call, std::string_view event_name, std::string_view event_payload);

/// Whose endorsements a call of the contract needs: a command's that of the drones' organisation, a batch's that of
/// one's own, all others' those of two organisations, by their functions. A stop goes out with what there is.
fabric::EndorsementNeed command_need(const std::string& organisation);
fabric::EndorsementNeed batch_need();
fabric::EndorsementNeed endorsement_need(std::string_view function);

/// The policy that a key of the contract has once it is there, for the keys whose names say whose they are; none: it
/// has none, or the name does not say. For fabric::ContractRules.
std::optional<std::string> likely_policy(std::string_view key);
/// Whether the key holds states or commands, by its name: agent goes by a command's sequence, ground by a state's
/// stamp. For fabric::ContractRules.
bool is_of_hot_path(std::string_view key);

/// A client of the contract asks those to endorse whose keys the call writes (endorsement_need, or the call itself),
/// and signs no result whose event is not what it asked for (check_event). In ledgerline_verification_client, as the
/// next.
fabric::ClientConfig for_contract(fabric::ClientConfig config);
/// submit_repeatedly() for calls of the contract: where another transaction was first, the drones are claimed for a
/// function that claims let through (contract::is_claimed_for), so that a client that floods the ledger does not keep
/// it off. Who may not claim goes on without. A claim is ended with the call, or the log says that it may stand. Waits;
/// any thread.
fabric::Outcome submit_claiming(fabric::Client& client, const fabric::Call& call,
                                const std::vector<std::string>& drones, const fabric::RepeatLimits& limits,
                                const std::function<void(const fabric::Outcome&)>& on_first_failure);

}  // namespace ledgerline::verification
