#pragma once
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "chaincode/node/core/ledger/history.hpp"
#include "chaincode/node/core/ledger/ledger.hpp"
#include "chaincode/node/core/ledger/simulation.hpp"
#include "chaincode/node/core/member_check.hpp"
#include "chaincode/node/core/tx/proposal.hpp"
#include "chaincode/node/core/types.hpp"
#include "peer/proposal_response.pb.h"

namespace ledgerline::node {

/// The peers' endorsing half: runs members' proposals against the committed state, changes nothing of it, and signs
/// what the contract said in the name of each peer. `config` and `ledger` must outlive it. One thread at a time.
class Endorser {
 public:
  /// `peers`: one for each organisation, all of them endorse.
  Endorser(const CoreConfig& config, MemberCheck members, std::vector<crypto::SigningIdentity> peers,
           const Ledger& ledger);
  Endorser(const Endorser&) = delete;
  Endorser& operator=(const Endorser&) = delete;

  /// As NodeCore's functions of these names.
  Reply endorse(std::string_view signed_proposal, Now now);
  Reply evaluate(std::string_view signed_proposal, Now now);
  Reply process_proposal(std::string_view signed_proposal, Now now, std::size_t peer);

 private:
  /// Why a proposal got no answer of the contract. The services give these different codes.
  enum class Kind { malformed, denied, unknown_channel, unknown_contract, duplicate };
  struct Simulated;
  struct Unanswered;
  std::variant<Simulated, Unanswered> simulate(std::string_view signed_proposal, Now now);
  std::string response_payload(const ProposalParts& proposal, const Simulation& simulation,
                               const chaincode::Response& response) const;

  const CoreConfig& config_;
  const MemberCheck members_;
  const std::vector<crypto::SigningIdentity> peers_;
  const Ledger& ledger_;
  History history_;
  const ReadVersion read_version_;
};

}  // namespace ledgerline::node
