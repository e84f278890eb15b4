#pragma once
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "chaincode/node/core/ledger/ledger.hpp"
#include "chaincode/node/core/ledger/simulation.hpp"
#include "chaincode/node/core/tx/messages.hpp"
#include "chaincode/node/core/types.hpp"
#include "peer/proposal_response.pb.h"

namespace ledgerline::node {

// The contracts that every peer of Fabric has of its own, as far as tools ask them: qscc (the chain) and cscc (the
// channels). They answer questions. A peer signs what they say of the channel; no transaction can be made of it.

bool is_system_contract(const std::string& contract);

/// What such a contract says; nullopt: the proposal is for none of them.
std::optional<chaincode::Response> query_system_contract(const Ledger& ledger, const std::string& channel,
                                                         const ProposalParts& proposal);

/// What Fabric's lifecycle says of the contract.
struct Definition {
  std::string version;              ///< of the contract, as it was committed
  std::optional<Version> sequence;  ///< where its sequence was written last: each result has read it
};

/// The peers' endorsing half: runs members' proposals against the committed state, changes nothing of it, and signs
/// what the contract said in the name of each peer. `config` and `ledger` must outlive it. One thread at a time.
class Endorser {
 public:
  /// `peers`: one for each organisation, all of them endorse.
  Endorser(const CoreConfig& config, MemberCheck members, std::vector<crypto::SigningIdentity> peers,
           const Ledger& ledger);
  /// From now on it answers byte for byte as a peer of Fabric: with the definition that `definition` gives (nullopt:
  /// the contract is not defined), with the ranges that such a peer reads, and with the result beside a refusal.
  void answer_as_fabric(std::function<std::optional<Definition>()> definition) { definition_ = std::move(definition); }
  /// Those of another configuration of the channel.
  void set_members(MemberCheck members) { members_ = std::move(members); }
  /// What this peer's certificate was renewed to.
  void set_peer(std::size_t peer, crypto::SigningIdentity identity) { peers_.at(peer) = std::move(identity); }
  Endorser(const Endorser&) = delete;
  Endorser& operator=(const Endorser&) = delete;

  /// As NodeCore's functions of these names.
  Reply endorse(std::string_view signed_proposal, Now now);
  Reply evaluate(std::string_view signed_proposal, Now now);
  Reply process_proposal(std::string_view signed_proposal, Now now, std::size_t peer);
  /// For who has read it already. `own`: this process has signed it, so its signature is not checked.
  Reply process_proposal(SignedProposalParts signed_proposal, Now now, std::size_t peer, bool own);

 private:
  /// Why a proposal got no answer of the contract. The services give these different codes.
  enum class Kind { malformed, denied, unknown_channel, unknown_contract, duplicate };
  struct Simulated;
  struct Unanswered;
  std::variant<Simulated, Unanswered> simulate(Result<SignedProposalParts> read, Now now, bool own = false);
  std::optional<std::string> over_share(const Simulation& simulation, const std::string& function,
                                        const std::string& msp_id) const;
  Reply reply_of_peer(const std::variant<Simulated, Unanswered>& answer, std::size_t peer) const;
  std::string response_payload(const ProposalParts& proposal, const Simulation& simulation,
                               const chaincode::Response& response, const Definition& definition) const;

  const CoreConfig& config_;
  MemberCheck members_;
  std::vector<crypto::SigningIdentity> peers_;
  const Ledger& ledger_;
  History history_;
  std::function<std::optional<Definition>()> definition_;  ///< empty: as the embedded node, without a lifecycle
};

}  // namespace ledgerline::node
