#pragma once
#include <string>

#include "common/fabric/client/client.hpp"

namespace ledgerline::fabric {

/// An endorser of the own organisation within this process (ClientConfig::own_endorser). Any thread.
class OwnEndorser {
 public:
  virtual ~OwnEndorser() = default;

  struct Answer {
    std::string response{};  ///< protos.ProposalResponse
    std::string problem{};   ///< why there is none; empty: there is
    bool elsewhere = false;  ///< another endorser may answer
  };
  /// To a protos.SignedProposal. Waits for nobody outside this process, but at most 0.2 s for the first under a
  /// definition of the contract.
  virtual Answer endorse(const std::string& signed_proposal) = 0;

  /// The handlers of a block stream that the process reads anyway, so that the blocks need not be read for the endorser
  /// alone. It takes a block after the given handler has had it.
  virtual Client::StreamHandlers fed_by(Client::StreamHandlers handlers) = 0;
};

}  // namespace ledgerline::fabric
