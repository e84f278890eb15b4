#include <algorithm>
#include <set>

#include "chaincode/node/core/core_parts.hpp"
#include "ledger/rwset/rwset.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/transaction.pb.h"

/// The committing half of the core: envelopes are checked, cut into blocks, validated and applied.
namespace ledgerline::node {

ContractSet read_contract_set(const protos::ChaincodeAction& action, const std::string& contract) {
  ContractSet result;
  rwset::TxReadWriteSet all;
  if (!all.ParseFromString(action.results())) return {protos::BAD_RWSET, {}};
  for (const rwset::NsReadWriteSet& part : all.ns_rwset()) {
    if (part.namespace_() != contract || !part.collection_hashed_rwset().empty()) return {protos::ILLEGAL_WRITESET, {}};
    if (!result.set.MergeFromString(part.rwset())) return {protos::BAD_RWSET, {}};
  }
  return result;
}

bool NodeCore::Parts::endorsed(const TransactionParts& transaction, Now now) {
  // The policy: one endorsement by any of the members' peers.
  for (const protos::Endorsement& endorsement : transaction.endorsements) {
    const bool peer = std::any_of(peers.begin(), peers.end(), [&](const crypto::SigningIdentity& known) {
      return known.serialized == endorsement.endorser();
    });
    if (peer && check(endorsement.endorser(), transaction.response_payload + endorsement.endorser(),
                      endorsement.signature(), now)
                    .ok()) {
      return true;
    }
  }
  return false;
}

namespace {

/// An event that names another contract or transaction would reach readers under a false name. (Fabric looks at the
/// contract alone.)
bool own_event(const TransactionParts& transaction, const std::string& contract) {
  if (transaction.action.events().empty()) return true;
  protos::ChaincodeEvent event;
  return event.ParseFromString(transaction.action.events()) && event.chaincode_id() == contract &&
         event.tx_id() == transaction.channel_header.tx_id();
}

}  // namespace

int NodeCore::Parts::validate(const TransactionParts& transaction, Now now, kvrwset::KVRWSet& set) {
  if (transaction.code != protos::VALID) return transaction.code;
  if (state.find_tx(transaction.channel_header.tx_id())) return protos::DUPLICATE_TXID;
  if (transaction.action.chaincode_id().name() != config.contract) return protos::INVALID_CHAINCODE;
  ContractSet contract_set = read_contract_set(transaction.action, config.contract);
  if (contract_set.code != protos::VALID) return contract_set.code;
  if (!own_event(transaction, config.contract)) return protos::INVALID_OTHER_REASON;
  if (!endorsed(transaction, now)) return protos::ENDORSEMENT_POLICY_FAILURE;
  set = std::move(contract_set.set);
  return protos::VALID;
}

CutBlock NodeCore::Parts::finish_block(const std::vector<std::string>& envelopes, const std::vector<TxStatus>& statuses,
                                       std::vector<Write> writes) {
  common::Block block = make_block(height, last_hash, envelopes, statuses);
  CutBlock cut{height, {}, statuses, {}};
  if (Status status = sign_block(block, orderer); !status) cut.warning = status.error().what;
  cut.bytes = block.SerializeAsString();
  under_way = UnderWay{height, header_hash(block.header()), std::move(writes)};
  return cut;
}

Reply NodeCore::order(std::string_view bytes, Now now) {
  const auto refuse = [](Code code, const std::string& status, const std::string& info) {
    return Reply{code, info, "received unsuccessful response from orderer: status=" + status + ", info=" + info, {}};
  };
  const CoreConfig& config = parts_->config;
  common::Envelope envelope;
  common::Payload payload;
  common::ChannelHeader channel_header;
  common::SignatureHeader signature_header;
  if (!envelope.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())) ||
      !payload.ParseFromString(envelope.payload()) ||
      !channel_header.ParseFromString(payload.header().channel_header()) ||
      !signature_header.ParseFromString(payload.header().signature_header())) {
    return refuse(Code::invalid_argument, "BAD_REQUEST", "the envelope does not parse");
  }
  if (channel_header.channel_id() != config.channel) {
    return refuse(Code::not_found, "BAD_REQUEST",
                  "channel " + printable(channel_header.channel_id(), max_name) + " not found");
  }
  if (channel_header.type() != common::ENDORSER_TRANSACTION) {
    return refuse(Code::invalid_argument, "BAD_REQUEST",
                  "header type " + std::to_string(channel_header.type()) + " is not served by this node");
  }
  const std::size_t size = envelope.payload().size() + envelope.signature().size();
  if (size > config.max_envelope_bytes) {
    return refuse(Code::invalid_argument, "BAD_REQUEST",
                  "message payload is " + std::to_string(size) + " bytes and exceeds maximum allowed " +
                      std::to_string(config.max_envelope_bytes) + " bytes");
  }
  const auto member = parts_->check(signature_header.creator(), envelope.payload(), envelope.signature(), now);
  if (!member && Parts::has_expired(signature_header.creator(), now)) {
    return refuse(Code::invalid_argument, "BAD_REQUEST", "broadcast client identity expired");
  }
  if (!member) return refuse(Code::permission_denied, "FORBIDDEN", member.error().what);
  const bool heavy = !parts_->pending.empty() && parts_->pending_bytes + bytes.size() > config.max_waiting_bytes;
  if (parts_->pending.size() >= config.max_waiting || heavy) {
    return refuse(Code::unavailable, "SERVICE_UNAVAILABLE",
                  std::to_string(parts_->pending.size()) + " envelopes wait for a block already");
  }
  parts_->pending.push_back({std::string(bytes), now.monotonic_ns});
  parts_->pending_bytes += bytes.size();
  return {};
}

std::optional<TimeNs> NodeCore::next_cut() const {
  if (parts_->under_way || parts_->pending.empty()) return std::nullopt;
  const TimeNs oldest = parts_->pending.front().arrived_ns;
  const bool full =
      parts_->pending.size() >= parts_->config.batch_count || parts_->pending_bytes >= parts_->config.batch_bytes;
  return full ? oldest : oldest + parts_->config.batch_timeout_ns;
}

std::optional<CutBlock> NodeCore::cut(Now now) {
  const auto due = next_cut();
  if (!due || *due > now.monotonic_ns) return std::nullopt;
  std::vector<std::string> envelopes;
  std::size_t bytes = 0;
  auto& pending = parts_->pending;
  while (!pending.empty() && envelopes.size() < std::max<std::size_t>(parts_->config.batch_count, 1)) {
    const std::size_t size = pending.front().envelope.size();
    if (!envelopes.empty() && bytes + size > parts_->config.batch_bytes) break;
    bytes += size;
    parts_->pending_bytes -= size;
    envelopes.push_back(std::move(pending.front().envelope));
    pending.pop_front();
  }

  Overlay overlay(parts_->state);
  std::vector<TxStatus> statuses;
  std::vector<Parts::Write> writes;
  std::set<std::string> ids;
  for (const std::string& envelope : envelopes) {
    const TransactionParts transaction = read_transaction(envelope);
    kvrwset::KVRWSet set;
    int code = parts_->validate(transaction, now, set);
    // As in Fabric, a transaction that fails for what it read has used its id up, also within the block.
    if (code == protos::VALID && !ids.insert(transaction.channel_header.tx_id()).second) code = protos::DUPLICATE_TXID;
    if (code == protos::VALID) code = overlay.check(set);
    if (code == protos::VALID) {
      overlay.add(set);
      writes.push_back({{parts_->height, statuses.size()}, std::move(set)});
    }
    statuses.push_back({transaction.channel_header.tx_id(), parts_->height, code});
  }
  return parts_->finish_block(envelopes, statuses, std::move(writes));
}

CutBlock NodeCore::genesis() {
  const std::string envelope = make_config_envelope(parts_->config, parts_->orderer);
  return parts_->finish_block({envelope}, {TxStatus{"", 0, protos::VALID}}, {});
}

Applied NodeCore::apply(const CutBlock& block) {
  Applied applied;
  applied.block = block.number;
  applied.transactions = block.transactions;
  for (const Parts::Write& write : parts_->under_way->writes) {
    for (const kvrwset::KVWrite& entry : write.set.writes()) parts_->state.write(entry, write.version);
  }
  parts_->last_hash = parts_->under_way->hash;
  parts_->under_way.reset();
  ++parts_->height;
  ++parts_->counts.blocks;
  for (const TxStatus& status : block.transactions) {
    if (status.tx_id.empty()) continue;
    ++parts_->counts.transactions;
    if (status.code != protos::VALID) ++parts_->counts.invalid;
    // Anyone can claim a wrong id: it must not keep the right transaction out.
    if (status.code != protos::BAD_PROPOSAL_TXID) parts_->state.add_tx(status.tx_id, {status.block, status.code});
    const auto waiting = parts_->waiters.find(status.tx_id);
    if (waiting == parts_->waiters.end() || status.code == protos::BAD_PROPOSAL_TXID) continue;
    for (const std::uint64_t waiter : waiting->second) applied.answers.push_back({waiter, status});
    parts_->waiters.erase(waiting);
  }
  return applied;
}

}  // namespace ledgerline::node
