#include "common/fabric/receipt/receipt.hpp"

#include <fmt/format.h>

#include <map>

#include "common/base/text.hpp"
#include "common/common.pb.h"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "msp/identities.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"

namespace ledgerline::fabric {
namespace {

constexpr std::string_view first_line = "ledgerline receipt 1\n";
constexpr std::size_t length_bytes = 4;  // big-endian
constexpr std::size_t number_bytes = 8;

class Writer {
 public:
  void number(std::uint64_t value, std::size_t bytes) {
    for (std::size_t i = bytes; i > 0; --i) out_.push_back(static_cast<char>(value >> (8 * (i - 1)) & 0xff));
  }
  void text(std::string_view value) {
    number(value.size(), length_bytes);
    out_ += value;
  }
  void signature(const Receipt::Signature& one) {
    text(one.signer);
    text(one.signature);
  }
  std::string take() { return std::move(out_); }

 private:
  std::string out_{first_line};
};

/// Ends quietly at the first value that is not there; `good` says so.
class Reader {
 public:
  explicit Reader(std::string_view rest) : rest_(rest) {}

  std::uint64_t number(std::size_t bytes) {
    if (rest_.size() < bytes) return fail();
    std::uint64_t value = 0;
    for (const char c : rest_.substr(0, bytes)) value = value << 8 | static_cast<unsigned char>(c);
    rest_.remove_prefix(bytes);
    return value;
  }
  std::string text() {
    const std::uint64_t length = number(length_bytes);
    if (length > rest_.size()) fail();
    if (!good_) return {};
    std::string value(rest_.substr(0, length));
    rest_.remove_prefix(length);
    return value;
  }
  Receipt::Signature signature() {
    std::string signer = text();
    return {std::move(signer), text()};
  }
  /// So many values follow; where they do not, reading them ends at the first that is not there.
  std::uint64_t count() { return number(length_bytes); }
  bool ended() const { return good_ && rest_.empty(); }
  bool good() const { return good_; }

 private:
  std::uint64_t fail() {
    good_ = false;
    rest_ = {};
    return 0;
  }
  std::string_view rest_;
  bool good_ = true;
};

}  // namespace

std::string receipt_bytes(const Receipt& receipt) {
  Writer out;
  out.text(receipt.channel);
  out.text(receipt.tx_id);
  out.number(receipt.block.number, number_bytes);
  out.text(receipt.block.previous_hash);
  out.text(receipt.block.data_hash);
  out.number(receipt.block.data.size(), length_bytes);
  for (const std::string& envelope : receipt.block.data) out.text(envelope);
  out.text(receipt.block.orderers_value);
  out.number(receipt.block.orderers.size(), length_bytes);
  for (const Receipt::Signature& one : receipt.block.orderers) out.signature(one);
  out.text(receipt.question);
  out.number(receipt.answers.size(), length_bytes);
  for (const Receipt::Answer& answer : receipt.answers) {
    out.text(answer.payload);
    out.signature(answer.endorsement);
  }
  return out.take();
}

Result<Receipt> read_receipt(std::string_view bytes) {
  if (!bytes.starts_with(first_line)) return Error{"it is no receipt, or of another version than 1"};
  if (bytes.size() > max_receipt_bytes)
    return Error{fmt::format("it has {} bytes; a receipt has {} at most", bytes.size(), max_receipt_bytes)};
  Reader in(bytes.substr(first_line.size()));
  Receipt receipt;
  receipt.channel = in.text();
  receipt.tx_id = in.text();
  receipt.block.number = in.number(number_bytes);
  receipt.block.previous_hash = in.text();
  receipt.block.data_hash = in.text();
  for (std::uint64_t left = in.count(); left > 0 && in.good(); --left) receipt.block.data.push_back(in.text());
  receipt.block.orderers_value = in.text();
  for (std::uint64_t left = in.count(); left > 0 && in.good(); --left) receipt.block.orderers.push_back(in.signature());
  receipt.question = in.text();
  for (std::uint64_t left = in.count(); left > 0 && in.good(); --left) {
    std::string payload = in.text();
    receipt.answers.push_back({std::move(payload), in.signature()});
  }
  if (!in.ended()) return Error{in.good() ? "something follows behind its end" : "it is cut off or damaged"};
  return receipt;
}

Result<Question> read_question(std::string_view question, const std::string& channel, const std::string& tx_id) {
  protos::Proposal proposal;
  common::Header header;
  common::ChannelHeader channel_header;
  common::SignatureHeader asker;
  if (!parse(proposal, question) || !parse(header, proposal.header()) ||
      !parse(channel_header, header.channel_header()) || !parse(asker, header.signature_header()))
    return Error{"the question to the peers is malformed"};
  // What the asker chose of a question is creator, nonce and time; all else of it follows.
  if (proposal_bytes(asker, {channel, chain_contract}, {verdict_function, {channel, tx_id}},
                     channel_header.timestamp()) != question)
    return Error{"the peers were not asked for this transaction's verdict"};
  return Question{proposal_hash(header.channel_header(), header.signature_header(), proposal.payload()),
                  channel_header.timestamp().seconds()};
}

Result<protos::ProcessedTransaction> read_answer(std::string_view bytes, const std::string& hash) {
  protos::ProposalResponsePayload payload;
  protos::ChaincodeAction action;
  protos::ProcessedTransaction said;
  if (!parse(payload, bytes) || !parse(action, payload.extension())) return Error{"is malformed"};
  if (payload.proposal_hash() != hash) return Error{"answers another question"};
  if (action.chaincode_id().name() != chain_contract)
    return Error{fmt::format("is not of {}", chain_contract)};  // a contract could answer whatever it likes
  if (action.response().status() != 200)
    return Error{fmt::format("is a refusal: {}", printable(action.response().message(), 200))};
  if (!parse(said, action.response().payload())) return Error{"is malformed"};
  return said;
}

std::string name_of_code(int code) {
  const std::string name = protos::TxValidationCode_Name(static_cast<protos::TxValidationCode>(code));
  return name.empty() ? fmt::format("code {}", code) : name;
}

namespace {

Result<Receipt::Block> what_is_signed(std::string_view bytes) {
  common::Block block;
  common::Metadata metadata;
  if (!parse(block, bytes)) return Error{"the block that the peer gave cannot be parsed"};
  if (block.metadata().metadata_size() <= common::SIGNATURES ||
      !parse(metadata, block.metadata().metadata(common::SIGNATURES)) || metadata.signatures().empty())
    return Error{fmt::format("block {}: no orderer has signed it", block.header().number())};
  Receipt::Block out;
  out.number = block.header().number();
  out.previous_hash = block.header().previous_hash();
  out.data_hash = block.header().data_hash();
  out.data.assign(block.data().data().begin(), block.data().data().end());
  out.orderers_value = metadata.value();
  for (const auto& one : metadata.signatures()) out.orderers.push_back({one.signature_header(), one.signature()});
  return out;
}

struct ParsedAnswer {
  std::string peer, organisation;
  int code = 0;
  Receipt::Answer answer;
};
Result<ParsedAnswer> read_response(const PeerAnswer& from, const std::string& hash) {
  const auto wrong = [&](const std::string& why) { return Error{fmt::format("{}: its answer {}", from.peer, why)}; };
  protos::ProposalResponse response;
  msp::SerializedIdentity identity;
  if (!parse(response, from.response)) return wrong("cannot be parsed");
  if (response.response().status() != 200) return wrong("is a refusal: " + printable(response.response().message()));
  if (!response.has_endorsement() || !parse(identity, response.endorsement().endorser())) return wrong("is not signed");
  const auto said = read_answer(response.payload(), hash);
  if (!said) return wrong(said.error().message);
  return ParsedAnswer{from.peer,
                      identity.mspid(),
                      said->validationcode(),
                      {response.payload(), {response.endorsement().endorser(), response.endorsement().signature()}}};
}

}  // namespace

Result<Receipt> make_receipt(const std::string& channel, const std::string& tx_id, std::string_view block,
                             std::string_view signed_question, const std::vector<PeerAnswer>& answers) {
  Receipt receipt;
  receipt.channel = channel;
  receipt.tx_id = tx_id;
  auto signed_block = what_is_signed(block);
  if (!signed_block) return signed_block.error();
  receipt.block = std::move(*signed_block);
  protos::SignedProposal question;
  if (!parse(question, signed_question)) return Error{"the question to the peers is malformed"};
  receipt.question = question.proposal_bytes();
  const auto asked = read_question(receipt.question, channel, tx_id);
  if (!asked) return asked.error();
  std::map<std::string, ParsedAnswer> by_organisation;
  for (const PeerAnswer& answer : answers) {
    auto said = read_response(answer, asked->hash);
    if (!said) return said.error();
    if (!by_organisation.empty() && by_organisation.begin()->second.code != said->code) {
      const ParsedAnswer& first = by_organisation.begin()->second;
      return Error{fmt::format("the peers differ: {} says {}, {} says {}", first.peer, name_of_code(first.code),
                               said->peer, name_of_code(said->code))};
    }
    by_organisation.emplace(said->organisation, std::move(*said));
  }
  if (by_organisation.empty()) return Error{"no peer has answered"};
  for (auto& [organisation, said] : by_organisation) receipt.answers.push_back(std::move(said.answer));
  return receipt;
}

}  // namespace ledgerline::fabric
