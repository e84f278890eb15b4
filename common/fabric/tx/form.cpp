#include "common/fabric/tx/form.hpp"

#include <cstdint>
#include <iterator>
#include <set>

#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/policy.hpp"
#include "ledger/rwset/rwset.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {

namespace {

bool complete(const common::SignatureHeader& header) { return !header.nonce().empty() && !header.creator().empty(); }

/// Fabric's BAD_COMMON_HEADER is everything else.
bool good_headers(const common::Header& header, TransactionForm& form) {
  const auto known = [](int type) {
    return type == common::ENDORSER_TRANSACTION || type == common::CONFIG || type == common::CONFIG_UPDATE;
  };
  return form.channel_header.ParseFromString(header.channel_header()) &&
         form.signature_header.ParseFromString(header.signature_header()) && known(form.channel_header.type()) &&
         form.channel_header.epoch() == 0 && complete(form.signature_header);
}

/// That there is one action, and that its response is of this proposal. The action has a signature header of its own,
/// of which the hash is made; that it is the creator's nobody asks.
int read_action(const common::Payload& payload, TransactionForm& form) {
  protos::Transaction transaction;
  if (!transaction.ParseFromString(payload.data()) || transaction.actions_size() != 1)
    return protos::INVALID_ENDORSER_TRANSACTION;
  const protos::TransactionAction& only = transaction.actions(0);
  common::SignatureHeader header;
  protos::ChaincodeActionPayload action;
  protos::ProposalResponsePayload response;
  if (!header.ParseFromString(only.header()) || !complete(header) || !action.ParseFromString(only.payload()))
    return protos::INVALID_ENDORSER_TRANSACTION;
  form.response_payload = std::move(*action.mutable_action()->mutable_proposal_response_payload());
  auto& endorsements = *action.mutable_action()->mutable_endorsements();
  form.endorsements.assign(std::move_iterator(endorsements.begin()), std::move_iterator(endorsements.end()));
  if (!response.ParseFromString(form.response_payload) ||
      response.proposal_hash() !=
          proposal_hash(payload.header().channel_header(), only.header(), action.chaincode_proposal_payload())) {
    return protos::INVALID_ENDORSER_TRANSACTION;
  }
  if (response.extension().empty() || !form.action.ParseFromString(response.extension()))
    return protos::BAD_RESPONSE_PAYLOAD;
  return protos::VALID;
}

bool read_collection(const rwset::CollectionHashedReadWriteSet& collection, kvrwset::KVRWSet& out) {
  kvrwset::HashedRWSet hashed;
  if (!hashed.ParseFromString(collection.hashed_rwset())) return false;
  for (const kvrwset::KVReadHash& read : hashed.hashed_reads()) {
    kvrwset::KVRead& as = *out.add_reads();
    as.set_key(read.key_hash());
    if (read.has_version()) *as.mutable_version() = read.version();
  }
  for (const kvrwset::KVWriteHash& write : hashed.hashed_writes()) {
    kvrwset::KVWrite& as = *out.add_writes();
    as.set_key(write.key_hash());
    as.set_is_delete(write.is_delete());
    as.set_value(write.value_hash());
  }
  for (const kvrwset::KVMetadataWriteHash& write : hashed.metadata_writes()) {
    kvrwset::KVMetadataWrite& as = *out.add_metadata_writes();
    as.set_key(write.key_hash());
    *as.mutable_entries() = write.entries();
  }
  return true;
}

constexpr std::uint8_t upsert = 1, new_metadata = 2, no_metadata = 4, deletion = 8;

struct KeyChange {
  std::uint8_t flags = 0;  // a sum, as in Fabric
  KeyEffect effect;
};

KeyEffect::Kind kind_of(std::uint8_t flags) {
  if ((flags & deletion) != 0) return KeyEffect::Kind::deletion;
  if ((flags & upsert) != 0 && (flags & (new_metadata | no_metadata)) != 0) return KeyEffect::Kind::value_and_policy;
  return flags == upsert ? KeyEffect::Kind::value : KeyEffect::Kind::policy;
}

}  // namespace

std::string transaction_id(const common::SignatureHeader& header) {
  return crypto::hex(crypto::sha256(header.nonce() + header.creator()));
}

std::string proposal_hash(const std::string& channel_header, const std::string& signature_header,
                          std::string_view payload) {
  std::string bytes = channel_header + signature_header;
  bytes.append(payload);
  const crypto::Digest digest = crypto::sha256(bytes);
  return {digest.begin(), digest.end()};
}

TimeNs time_of(const google::protobuf::Timestamp& timestamp) {
  constexpr std::int64_t last_s = 8'000'000'000;
  if (timestamp.seconds() < 0 || timestamp.seconds() > last_s || timestamp.nanos() < 0 || timestamp.nanos() >= ns_per_s)
    return 0;
  return timestamp.seconds() * ns_per_s + timestamp.nanos();
}

TransactionForm read_form(std::string_view bytes, const CreatorCheck& creator_check) {
  TransactionForm form;
  const auto wrong = [&](int code) {
    form.code = code;
    return std::move(form);
  };
  common::Envelope envelope;
  common::Payload payload;
  if (!parse(envelope, bytes)) return wrong(protos::INVALID_OTHER_REASON);
  if (!payload.ParseFromString(envelope.payload())) return wrong(protos::BAD_PAYLOAD);
  if (!good_headers(payload.header(), form)) return wrong(protos::BAD_COMMON_HEADER);
  form.config = form.channel_header.type() == common::CONFIG;
  if (creator_check && !creator_check(form.signature_header.creator(), envelope.payload(), envelope.signature()))
    return wrong(protos::BAD_CREATOR_SIGNATURE);
  if (form.config) return form;
  if (form.channel_header.type() != common::ENDORSER_TRANSACTION) return wrong(protos::UNSUPPORTED_TX_PAYLOAD);
  if (form.channel_header.tx_id() != transaction_id(form.signature_header)) return wrong(protos::BAD_PROPOSAL_TXID);
  return wrong(read_action(payload, form));
}

ReadWriteSet read_sets(const std::string& results) {
  ReadWriteSet out;
  rwset::TxReadWriteSet all;
  if (!all.ParseFromString(results)) return {protos::BAD_RWSET, {}};
  std::set<std::string> names;
  for (const rwset::NsReadWriteSet& one : all.ns_rwset()) {
    NamespaceSet own{one.namespace_(), {}, {}};
    if (!own.set.ParseFromString(one.rwset())) return {protos::BAD_RWSET, {}};
    if (!names.insert(own.name).second) out.code = protos::ILLEGAL_WRITESET;
    out.parts.push_back(std::move(own));
    for (const rwset::CollectionHashedReadWriteSet& collection : one.collection_hashed_rwset()) {
      NamespaceSet hashed{one.namespace_(), collection.collection_name(), {}};
      if (!read_collection(collection, hashed.set)) return {protos::BAD_RWSET, {}};
      out.parts.push_back(std::move(hashed));
    }
  }
  return out;
}

std::map<std::string, KeyEffect> effects_of(const kvrwset::KVRWSet& set) {
  std::map<std::string, KeyChange> said;
  for (const kvrwset::KVWrite& write : set.writes()) {
    KeyChange& one = said[write.key()];
    const bool deletes = write.is_delete() || write.value().empty();
    one.flags = static_cast<std::uint8_t>(one.flags + (deletes ? deletion : upsert));
    if (!deletes) one.effect.value = write.value();
  }
  for (const kvrwset::KVMetadataWrite& write : set.metadata_writes()) {
    KeyChange& one = said[write.key()];
    one.flags = static_cast<std::uint8_t>(one.flags + (write.entries().empty() ? no_metadata : new_metadata));
    if (write.entries().empty()) continue;
    one.effect.policy.clear();
    for (const kvrwset::KVMetadataEntry& entry : write.entries()) {
      if (entry.name() == validation_parameter) one.effect.policy = entry.value();
    }
  }
  std::map<std::string, KeyEffect> effects;
  for (auto& [key, one] : said) {
    one.effect.kind = kind_of(one.flags);
    effects.emplace(key, std::move(one.effect));
  }
  return effects;
}

}  // namespace ledgerline::fabric
