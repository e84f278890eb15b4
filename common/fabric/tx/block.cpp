#include <fmt/format.h>

#include "common/common.pb.h"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "peer/chaincode.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/proposal.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {
namespace {

/// What the endorsers signed: event, and that it is of this contract and transaction. Fabric's peers look at the
/// contract's name alone before they flag a transaction valid.
const char* read_action(const std::string& response_payload, Transaction& out) {
  protos::ProposalResponsePayload response;
  protos::ChaincodeAction action;
  if (!parse(response, response_payload) || !parse(action, response.extension()))
    return "its proposal response is malformed";
  if (action.events().empty()) return nullptr;
  protos::ChaincodeEvent event;
  if (!parse(event, action.events())) return "its event is malformed";
  if (event.chaincode_id() != out.contract) return "its event names another contract";
  if (event.tx_id() != out.tx_id) return "its event names another transaction";
  out.event_name = std::move(*event.mutable_event_name());
  out.event_payload = std::move(*event.mutable_payload());
  return nullptr;
}

/// What the creator asked for. It lies within the payload that the creator's signature covers, and nothing else is read
/// here. What is no call leaves it empty.
void read_input(const std::string& proposal_payload, Transaction& out) {
  protos::ChaincodeProposalPayload proposal;
  protos::ChaincodeInvocationSpec invocation;
  if (!parse(proposal, proposal_payload) || !parse(invocation, proposal.input())) return;
  auto& args = *invocation.mutable_chaincode_spec()->mutable_input()->mutable_args();
  if (args.empty()) return;
  out.function = std::move(args[0]);
  out.args.reserve(static_cast<std::size_t>(args.size()) - 1);
  for (int i = 1; i < args.size(); ++i) out.args.push_back(std::move(args[i]));
}

const char* read_call(const common::ChannelHeader& channel, const common::Payload& payload, Transaction& out) {
  common::SignatureHeader signature_header;
  if (!parse(signature_header, payload.header().signature_header())) return "its signature header is malformed";
  out.creator = std::move(*signature_header.mutable_creator());
  protos::ChaincodeHeaderExtension extension;
  if (!parse(extension, channel.extension())) return "its header extension is malformed";
  out.contract = extension.chaincode_id().name();
  protos::Transaction transaction;
  if (!parse(transaction, payload.data())) return "its payload is no transaction";
  if (transaction.actions_size() != 1) return "it must have exactly one action";
  protos::ChaincodeActionPayload action;
  if (!parse(action, transaction.actions(0).payload())) return "its action is malformed";
  read_input(action.chaincode_proposal_payload(), out);
  protos::ChaincodeEndorsedAction& endorsed = *action.mutable_action();
  out.response_payload = std::move(*endorsed.mutable_proposal_response_payload());
  for (protos::Endorsement& e : *endorsed.mutable_endorsements()) {
    out.endorsements.push_back({std::move(*e.mutable_endorser()), std::move(*e.mutable_signature())});
  }
  return read_action(out.response_payload, out);
}

/// Leaves what may still be said of a transaction that is not what its flag says: who it is, and why.
void distrust(Transaction& transaction, const char* why) {
  Transaction bare;
  bare.tx_id = std::move(transaction.tx_id);
  bare.channel = std::move(transaction.channel);
  bare.contract = std::move(transaction.contract);
  bare.code = code_unverified;
  bare.problem = why;
  transaction = std::move(bare);
}

/// nullptr, or what is wrong.
const char* read_transaction(const std::string& bytes, Transaction& out) {
  common::Envelope envelope;
  if (!parse(envelope, bytes)) return "it is no envelope";
  common::Payload payload;
  if (!parse(payload, envelope.payload())) return "its payload is malformed";
  common::ChannelHeader channel;
  if (!parse(channel, payload.header().channel_header())) return "its channel header is malformed";
  out.tx_id = channel.tx_id();
  out.channel = channel.channel_id();
  out.timestamp_ns = time_of(channel.timestamp());
  if (channel.type() == common::CONFIG) {
    out.config = true;
    return nullptr;
  }
  if (channel.type() != common::ENDORSER_TRANSACTION) return "it is neither a call nor a configuration";
  out.payload = std::move(*envelope.mutable_payload());
  out.signature = std::move(*envelope.mutable_signature());
  return read_call(channel, payload, out);
}

void put_length(std::string& der, std::size_t length) {
  if (length < 128) {
    der.push_back(static_cast<char>(length));
    return;
  }
  std::string digits;
  for (std::size_t rest = length; rest > 0; rest >>= 8) digits.insert(digits.begin(), static_cast<char>(rest & 0xff));
  der.push_back(static_cast<char>(0x80 | digits.size()));
  der += digits;
}

void put_element(std::string& der, char tag, std::string_view content) {
  der.push_back(tag);
  put_length(der, content.size());
  der += content;
}

}  // namespace

Result<Block> decode_block(const common::Block& block) {
  Block out;
  out.number = block.header().number();
  out.previous_hash = block.header().previous_hash();
  out.data_hash = block.header().data_hash();
  if (out.data_hash != fabric::data_hash(block.data())) {
    return Error{fmt::format("block {}: its data does not match its data hash", out.number)};
  }
  const auto count = static_cast<std::size_t>(block.data().data_size());
  const std::string_view flags = flags_of(block);
  if (!flags.empty() && flags.size() != count) {
    return Error{fmt::format("block {}: it has {} transactions but {} flags", out.number, count, flags.size())};
  }
  out.transactions.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    Transaction& transaction = out.transactions[i];
    const char* wrong = read_transaction(block.data().data(static_cast<int>(i)), transaction);
    transaction.code = flags.empty() ? -1 : static_cast<unsigned char>(flags[i]);
    if (wrong == nullptr) continue;
    if (transaction.code == protos::VALID) distrust(transaction, wrong);
    if (transaction.code == -1) transaction.code = protos::BAD_PAYLOAD;
  }
  return out;
}

Result<Block> decode_block(std::string_view bytes) {
  common::Block block;
  if (!parse(block, bytes)) return Error{"a block that cannot be parsed"};
  return decode_block(block);
}

std::string block_header_bytes(std::uint64_t number, std::string_view previous_hash, std::string_view data_hash) {
  std::string digits;  // shortest two's complement of a positive number
  do {
    digits.insert(digits.begin(), static_cast<char>(number & 0xff));
    number >>= 8;
  } while (number > 0);
  if (static_cast<unsigned char>(digits[0]) & 0x80) digits.insert(digits.begin(), '\0');
  std::string body, sequence;
  put_element(body, 0x02, digits);
  put_element(body, 0x04, previous_hash);
  put_element(body, 0x04, data_hash);
  put_element(sequence, 0x30, body);
  return sequence;
}

std::string block_header_hash(std::uint64_t number, std::string_view previous_hash, std::string_view data_hash) {
  const crypto::Digest digest = crypto::sha256(block_header_bytes(number, previous_hash, data_hash));
  return {digest.begin(), digest.end()};
}

std::string_view flags_of(const common::Block& block) {
  if (block.metadata().metadata_size() <= common::TRANSACTIONS_FILTER) return {};
  return block.metadata().metadata(common::TRANSACTIONS_FILTER);
}

std::string header_hash(const common::BlockHeader& header) {
  return block_header_hash(header.number(), header.previous_hash(), header.data_hash());
}

std::string data_hash(const common::BlockData& data) {
  std::string all;
  for (const std::string& envelope : data.data()) all += envelope;
  const crypto::Digest digest = crypto::sha256(all);
  return {digest.begin(), digest.end()};
}

ChainCheck ChainCheck::behind(std::uint64_t number, std::string hash) {
  ChainCheck check;
  check.started_ = true;
  check.next_ = number + 1;
  check.hash_ = std::move(hash);
  return check;
}

Status ChainCheck::add(const Block& block) {
  if (started_ && block.number != next_)
    return Error{fmt::format("block {} came where {} was due", block.number, next_)};
  if (started_ && block.previous_hash != hash_) {
    return Error{
        fmt::format("block {} does not follow block {}: it names another previous hash", block.number, next_ - 1)};
  }
  started_ = true;
  next_ = block.number + 1;
  hash_ = block_header_hash(block.number, block.previous_hash, block.data_hash);
  return done;
}

void ValidatedShare::add(TimeNs now, const Block& block) {
  for (const Transaction& tx : block.transactions) {
    if (tx.config) continue;
    ++(tx.by_flag ? by_flag_ : validated_);
    ++now_.of;
    if (tx.by_flag) ++now_.by_flag;
  }
  if (now - begun_ns_ < window_ns) return;
  begun_ns_ = now;
  const Rise window = std::exchange(now_, {});
  if (window.of < fewest) return;
  if (low_ && 2 * window.by_flag > window.of) {
    rise_ = window;
    low_ = false;
  }
  if (4 * window.by_flag < window.of) low_ = true;
}

std::optional<ValidatedShare::Rise> ValidatedShare::pop_rise() { return std::exchange(rise_, std::nullopt); }

}  // namespace ledgerline::fabric
