#pragma once
#include <deque>
#include <map>

#include "chaincode/node/core/block.hpp"
#include "chaincode/node/core/core.hpp"
#include "chaincode/node/core/proposal.hpp"
#include "chaincode/node/core/simulation.hpp"
#include "chaincode/node/core/state.hpp"

/// What the core is made of; for core*.cpp alone.
namespace ledgerline::node {

/// A proposal that may be answered, and what the contract said.
struct Simulated {
  ProposalParts proposal;
  chaincode::Response response;
  std::string payload;  ///< ProposalResponsePayload; empty: nothing to endorse
};

/// One of the peer's own contracts.
bool is_system(const std::string& contract);

/// Why a proposal got no answer of the contract. The services give these different codes.
struct Unanswered {
  enum class Kind { malformed, denied, unknown_channel, unknown_contract, duplicate } kind;
  std::string what;
};

struct NodeCore::Parts {
  CoreConfig config;
  std::shared_ptr<crypto::MspRegistry> registry;
  std::vector<crypto::SigningIdentity> peers;
  crypto::SigningIdentity orderer;
  ReadBlock read_block;
  ReadVersion read_version;

  State state;
  std::uint64_t height = 0;
  std::string last_hash;
  Counts counts;

  struct Pending {
    std::string envelope;
    TimeNs arrived_ns;
  };
  std::deque<Pending> pending;
  std::size_t pending_bytes = 0;

  struct Write {
    Version version;
    kvrwset::KVRWSet set;
  };
  struct UnderWay {
    std::uint64_t number;
    std::string hash;
    std::vector<Write> writes;
  };
  std::optional<UnderWay> under_way;
  std::map<std::string, std::vector<std::uint64_t>> waiters;

  /// The block that history looked into last: many versions lie in one.
  std::optional<common::Block> history_block;

  /// Checks a signature of a member; the error is in Fabric's words.
  Result<std::shared_ptr<const crypto::MspRegistry::Member>> check(std::string_view serialized,
                                                                   std::string_view message, std::string_view signature,
                                                                   Now now);
  /// The certificate of a SerializedIdentity is one whose time is over.
  static bool has_expired(const std::string& serialized, Now now);
  /// What the peer's own contracts say (qscc, cscc); nullopt: it is none of them.
  std::optional<chaincode::Response> ask_system(const ProposalParts& proposal);
  Result<common::Block> block_at(std::uint64_t number) const;
  std::variant<Simulated, Unanswered> simulate(std::string_view signed_proposal, Now now);
  Result<protos::Endorsement> endorse_by(const crypto::SigningIdentity& peer, const std::string& payload) const;
  Result<chaincode::KeyVersion> version_of(const std::string& key, Version version);

  /// A protos.TxValidationCode of everything but what was read; fills `set` when it is VALID.
  int validate(const TransactionParts& transaction, Now now, kvrwset::KVRWSet& set);
  bool endorsed(const TransactionParts& transaction, Now now);
  CutBlock finish_block(const std::vector<std::string>& envelopes, const std::vector<TxStatus>& statuses,
                        std::vector<Write> writes);
};

/// The contract's part of a transaction's read-write set; an error says which rule it breaks as a TxValidationCode.
struct ContractSet {
  int code = 0;
  kvrwset::KVRWSet set;
};
ContractSet read_contract_set(const protos::ChaincodeAction& action, const std::string& contract);

}  // namespace ledgerline::node
