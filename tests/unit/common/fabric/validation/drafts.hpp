#pragma once
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "common/base/random.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/validation/key_state.hpp"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"

/// Transactions in the making, good and spoilt, with real signatures: endorsed with the peers' keys, without
/// any contract. For comparing what a validator says of them with what a peer says.
namespace ledgerline::fabric {

/// Everybody in a network whose keys we have.
struct Cast {
  std::vector<crypto::SigningIdentity> members;    ///< of organisation 1, 2, 3
  std::vector<crypto::SigningIdentity> peers;      ///< likewise
  std::vector<crypto::SigningIdentity> new_peers;  ///< likewise, with certificates that nobody has seen
  crypto::SigningIdentity admin, client, nobodys;  ///< of organisation 1; the last: OU=peer of an authority of nobody's
};

/// Each layer may be changed before the next is made around it.
struct Draft {
  const crypto::SigningIdentity* creator = nullptr;
  std::vector<const crypto::SigningIdentity*> endorsers;
  common::ChannelHeader channel_header;
  protos::ChaincodeHeaderExtension extension;
  std::string nonce;
  kvrwset::KVRWSet set;  ///< of `ledgerline`
  protos::ChaincodeAction action;

  std::function<void(std::string& results)> on_results{};
  std::function<void(std::string& extension)> on_extension{};
  std::function<void(common::ChannelHeader&, common::SignatureHeader&)> on_headers{};
  std::function<void(protos::ProposalResponsePayload&)> on_response{};
  std::function<void(std::string& bytes)> on_response_bytes{};
  std::function<void(protos::Endorsement&)> on_endorsement{};
  std::function<void(std::vector<protos::Endorsement>&)> on_endorsements{};
  std::function<void(std::string& action_header)> on_action_header{};
  std::function<void(protos::Transaction&)> on_transaction{};
  std::function<void(std::string& payload_data)> on_data{};
  std::function<void(std::string& envelope)> on_envelope{};

  /// A signed common.Envelope.
  std::string seal();
};

/// A way in which a transaction may be good or bad: makes one; may look at what is on the ledger. `again`: what was
/// ordered last, to be ordered once more as it is.
struct Kind {
  std::string name;
  std::function<void(Draft&)> bend;
  bool again = false;
  /// Fabric's peers of 2.5.0 wait for ever, or end, where one behind it in its block writes: so it has a block of its
  /// own.
  bool alone = false;
};
/// `state`: of the moment when a draft is bent.
std::vector<Kind> kinds(const Cast& cast, const KeyState& state, Random& random);

}  // namespace ledgerline::fabric
