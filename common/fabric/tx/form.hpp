#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "common/common.pb.h"
#include "common/rt/clock.hpp"
#include "ledger/rwset/kvrwset/kv_rwset.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"

/// Transactions opened as a peer's committer opens them, with Fabric's code of the first thing that is wrong. Pure.
namespace ledgerline::fabric {

/// A message of protobuf out of at most 2 GiB.
template <typename Message>
bool parse(Message& message, std::string_view bytes) {
  return bytes.size() <= INT32_MAX && message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

/// Hex SHA-256 of nonce and creator.
std::string transaction_id(const common::SignatureHeader& header);
inline constexpr std::size_t id_digits = 64;  ///< of such an id: no valid transaction has another one
/// What ties a response to its proposal. `payload`: ChaincodeProposalPayload without the transient map.
std::string proposal_hash(const std::string& channel_header, const std::string& signature_header,
                          std::string_view payload);

/// Since 1970, as a client claims it, who may claim anything; 0: what is no time of our age.
TimeNs time_of(const google::protobuf::Timestamp& timestamp);

struct TransactionForm {
  int code = 0;         ///< protos.TxValidationCode: VALID, or what is wrong with its form
  bool config = false;  ///< a configuration: only the headers are read
  common::ChannelHeader channel_header;
  common::SignatureHeader signature_header;
  std::string response_payload;  ///< protos.ProposalResponsePayload, which endorsements sign
  std::vector<protos::Endorsement> endorsements;
  protos::ChaincodeAction action;
};
/// Whether `signature` of `payload` is that of `creator` (msp.SerializedIdentity), a member.
using CreatorCheck =
    std::function<bool(const std::string& creator, const std::string& payload, const std::string& signature)>;
/// `envelope`: common.Envelope. Without a check of the creator every creator is taken. Layers that were opened before
/// something was found wrong are filled in.
TransactionForm read_form(std::string_view envelope, const CreatorCheck& creator_check = {});

/// What a transaction read and wrote in one namespace, or in one collection of private data of it. There, keys and
/// values are hashes, as all but the collection's members see them.
struct NamespaceSet {
  std::string name;
  std::string collection;  ///< empty: the namespace's own keys
  kvrwset::KVRWSet set;
  bool writes() const { return !set.writes().empty() || !set.metadata_writes().empty(); }
};
struct ReadWriteSet {
  int code = 0;                     ///< VALID, or BAD_RWSET or ILLEGAL_WRITESET (a namespace twice)
  std::vector<NamespaceSet> parts;  ///< in the order of the transaction
};
/// `results`: rwset.TxReadWriteSet.
ReadWriteSet read_sets(const std::string& results);

/// What one transaction does to one key.
struct KeyEffect {
  enum class Kind {
    value,             ///< a new value; the key's policy stays
    value_and_policy,  ///< both are new
    policy,            ///< the policy alone, where the key is there; else nothing
    deletion,          ///< of the policy, too
  };
  Kind kind = Kind::value;
  std::string value{};
  std::string policy{};  ///< common.SignaturePolicyEnvelope; empty: none from now on
};

/// By key, as Fabric 2.5 reads a set. An empty value is a deletion. Fabric adds up what is said of a key, so that a
/// value given twice in one set counts as new metadata alone, which no contract's peer makes; its state keeps the old
/// value then (core/ledger/kvledger/txmgmt/validation/tx_ops.go).
std::map<std::string, KeyEffect> effects_of(const kvrwset::KVRWSet& set);

}  // namespace ledgerline::fabric
