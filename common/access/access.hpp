#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "common/access/identity.hpp"
#include "common/access/rules.hpp"
#include "common/crypto/crypto.hpp"
#include "ledgerline.pb.h"

/// The rule book: who may change a drone's control record by which function of the contract, and what the record
/// becomes. The contract applies it and writes; agent, ground and audit apply it to what a block says and compare.
/// docs/access.md is its page. Pure; thread-safe as the messages are.
namespace ledgerline::access {

/// What a caller asks for, whichever of the three forms it was written in.
using CallMessage = std::variant<EnrollCall, RevokeCall, GrantCall, LeaseCall, AnswerCall, DronesCall>;
struct Call {
  std::string function;  ///< one of contract::control_functions
  CallMessage message;
};

struct Caller {
  crypto::IdentityName name;
  bool admin = false;  ///< by its certificate
};

/// Roles by name. The contract reads each one that the rules ask for (`all`): who has none there has none. A reader of
/// blocks knows some; what a rule asks of another is taken from the peer that ran the contract.
struct Roles {
  bool all = false;
  std::map<crypto::IdentityName, Role> known{};

  std::optional<Role> of(const crypto::IdentityName& who) const {
    const auto found = known.find(who);
    if (found != known.end()) return found->second;
    return all ? std::optional(ROLE_NONE) : std::nullopt;
  }
};

/// What the rules need beside a drone's record.
struct RuleInputs {
  Roles roles{};
  std::uint64_t new_epoch = 0;  ///< above the record's
  bool moves_streams = false;   ///< enroll: the host before has ids of this drone that stream
};

/// Why a call is refused: the rule, and the contract's words of it.
struct Refusal {
  Rule rule;
  std::string text;
};

/// Whose roles the rules ask for, by the call alone and by the record of one of its drones.
std::vector<crypto::IdentityName> roles_needed(const Call& call, const Caller& caller);
std::vector<crypto::IdentityName> roles_needed(const Call& call, const Control& before);

/// Why a call is refused whichever drone it is for.
std::optional<Refusal> check_call(const Call& call, const Caller& caller, const Roles& roles);

/// What the call makes of the record of one of its drones, or why it is refused; with check_call's refusals. Of a drone
/// that is not enrolled, `before` has its name alone. Not for `stop`.
std::variant<Control, Refusal> apply(const Control& before, const Call& call, const Caller& caller,
                                     const RuleInputs& inputs);

/// Why somebody may not stop the drone, or cut its motors: asked of the owner's organisation, the grants and the
/// revoked of its record alone, which administrators write, so that nobody makes a stop invalid by flying.
std::optional<Refusal> check_stop(const Control& record, const Caller& caller, std::optional<Role> role, bool cut);
/// Whether a stop outranks the lease: of a stopped drone's commands those alone count that land it.
inline bool is_outranked_by_stop(bool stopped, Action action) { return stopped && action != LAND; }
/// Why a stop is refused that is meant for another number of clears of its caller's stops than the ledger has.
std::optional<Refusal> check_clears(const DronesCall& call, const std::string& drone, const Caller& caller,
                                    std::uint64_t clears);

/// Whether somebody claims for the drone's organisation. `hosts`: the drone is enrolled to the caller itself.
bool claims_for_owner(const std::string& owner_msp_id, bool hosts, const Caller& caller, Role role);
/// Why somebody who is no such claimant may not claim either as the holder of the record's lease.
std::optional<Refusal> check_holders_claim(const Control& record, const Caller& caller, Role role);
/// Why a call has to wait for one who has claimed the drone for its organisation.
std::optional<Refusal> check_claimed(const std::vector<Identity>& claimants, const Control& record,
                                     const std::string& function, const Caller& caller);
/// The same for the claim of a holder, which is over with the lease of that epoch.
std::optional<Refusal> check_claimed(const HolderClaim& claim, const Control& record, const std::string& function,
                                     const Caller& caller);
/// Whether calls of a function ask for a holder's claim at all.
bool waits_for_holder(const std::string& function);

/// "Org2MSP CN=pilot, who lets Org2MSP CN=station command it": of a drone that somebody holds.
std::string holder_text(const Control& control);
std::string not_enrolled_text();

}  // namespace ledgerline::access
