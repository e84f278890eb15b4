#include "common/fabric/receipt/receipt_judge.hpp"

#include <fmt/format.h>
#include <google/protobuf/stubs/logging.h>

#include <algorithm>
#include <set>

#include "common/base/printable.hpp"
#include "common/common.pb.h"
#include "common/fabric/receipt/answer.hpp"
#include "common/fabric/receipt/receipt.hpp"
#include "common/fabric/tx/decode.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/tx/opened.hpp"

namespace ledgerline::fabric {
namespace {

constexpr std::size_t max_name = 200;  // of what strangers chose, in a message

using Names = std::vector<crypto::IdentityName>;

/// The block as decode_block takes it apart, with its data checked against its hash.
Result<Block> open_block(const Receipt::Block& from) {
  common::Block block;
  block.mutable_header()->set_number(from.number);
  block.mutable_header()->set_previous_hash(from.previous_hash);
  block.mutable_header()->set_data_hash(from.data_hash);
  for (const std::string& bytes : from.data) {
    // The hash is over all envelopes, one behind the other: where each has one form, it says where one ends.
    common::Envelope envelope;
    if (!envelope.ParseFromString(bytes) || envelope.payload().empty() || envelope.SerializeAsString() != bytes)
      return Error{fmt::format("block {}: it holds what no orderer puts into a block", from.number)};
    block.mutable_data()->add_data(bytes);
  }
  return decode_block(block);
}

Result<Names> orderers_of(const Receipt::Block& block, crypto::MspRegistry& orderers) {
  const auto wrong = [&](const std::string& why) { return Error{fmt::format("block {}: {}", block.number, why)}; };
  const std::string header = block_header_bytes(block.number, block.previous_hash, block.data_hash);
  Names names;
  for (const Receipt::Signature& one : block.orderers) {
    common::SignatureHeader who;
    if (!who.ParseFromString(one.signer)) return wrong("who signed it cannot be read");
    const auto member = orderers.member(who.creator(), std::nullopt);
    if (!member) return wrong("who signed it is no orderer that you named: " + member.error().what);
    if (!(*member)->orderer) return wrong(fmt::format("{} signed it and is no orderer", (*member)->name.subject));
    if (std::ranges::find(names, (*member)->name) != names.end())
      return wrong(fmt::format("{} signed it twice", (*member)->name.subject));
    if (!(*member)->verifier->verify(block.orderers_value + one.signer + header, one.signature))
      return wrong(fmt::format("the signature of {} is not of this block", (*member)->name.subject));
    names.push_back((*member)->name);
  }
  if (names.empty()) return wrong("no orderer has signed it");
  return names;
}

/// Where the transaction is in the block.
Result<std::size_t> find_transaction(const Receipt& receipt, const Block& block) {
  const auto wrong = [&](const std::string& why) {
    return Error{fmt::format("transaction {}: {}", printable(receipt.tx_id, max_name), why)};
  };
  for (const Transaction& one : block.transactions) {
    if (!one.channel.empty() && one.channel != receipt.channel)
      return Error{fmt::format("block {}: it is of channel {}, not of {}", block.number,
                               printable(one.channel, max_name), receipt.channel)};
  }
  const auto found = std::ranges::find(block.transactions, receipt.tx_id, &Transaction::tx_id);
  if (found == block.transactions.end()) return wrong(fmt::format("it is not in block {}", block.number));
  if (found->config) return wrong("it is a configuration of the channel");
  return static_cast<std::size_t>(found - block.transactions.begin());
}

/// Endorsements of this very call that are good.
Names endorsers_of(const Transaction& transaction, const OpenedTransaction& opened, crypto::MspRegistry& registry) {
  const common::Header& header = opened.payload.header();
  Names names;
  if (opened.response.proposal_hash() !=
      proposal_hash(header.channel_header(), header.signature_header(), opened.action.chaincode_proposal_payload()))
    return names;
  for (const Endorsement& one : transaction.endorsements) {
    const auto member = registry.member(one.endorser, std::nullopt);
    if (member && (*member)->peer &&
        (*member)->verifier->verify(transaction.response_payload + one.endorser, one.signature))
      names.push_back((*member)->name);
  }
  return names;
}

/// Creator and call into `out`: what the creator signed.
Status read_call(const Transaction& transaction, const OpenedTransaction& opened, crypto::MspRegistry& registry,
                 Proven& out) {
  const auto wrong = [&](const std::string& why) { return Error{fmt::format("transaction {}: {}", out.tx_id, why)}; };
  common::SignatureHeader header;
  if (!header.ParseFromString(opened.payload.header().signature_header())) return wrong("its creator cannot be read");
  if (out.tx_id != transaction_id(header)) return wrong("its id is not of its creator");
  const auto creator = registry.member(header.creator(), std::nullopt);
  if (!creator) return wrong("its creator is nobody of the organisations that you named: " + creator.error().what);
  if (!(*creator)->verifier->verify(opened.envelope.payload(), opened.envelope.signature()))
    return wrong("its creator's signature is wrong");
  out.creator = (*creator)->name;
  out.contract = transaction.contract;
  out.function = transaction.function;
  out.arguments = transaction.args.size();
  for (const std::string& arg : transaction.args) out.argument_bytes += arg.size();
  out.timestamp_ns = transaction.timestamp_ns;
  out.endorsers = endorsers_of(transaction, opened, registry);
  return done;
}

/// The verdict into `out`: what peers signed.
Status read_verdict(const Receipt& receipt, const common::Envelope& envelope, crypto::MspRegistry& registry,
                    Proven& out) {
  const auto hash = question_hash(receipt.question, receipt.channel, receipt.tx_id);
  if (!hash) return hash.error();
  for (const Receipt::Answer& answer : receipt.answers) {
    const auto member = registry.member(answer.endorsement.signer, std::nullopt);
    if (!member) return Error{"who answered is no peer of the organisations that you named: " + member.error().what};
    const crypto::IdentityName& name = (*member)->name;
    const auto wrong = [&](const std::string& why) {
      return Error{fmt::format("the answer of {} {}: it {}", name.msp_id, name.subject, why)};
    };
    if (!(*member)->peer) return wrong("is not of a peer");
    if (!out.peers.empty() && out.peers.back().msp_id >= name.msp_id)
      return wrong("is not the only one of its organisation, or not at its place");
    if (!(*member)->verifier->verify(answer.payload + answer.endorsement.signer, answer.endorsement.signature))
      return wrong("has a signature that is not its own");
    const auto said = read_answer(answer.payload, *hash);
    if (!said) return wrong(said.error().what);
    const common::Envelope& shown = said->transactionenvelope();
    if (shown.payload() != envelope.payload() || shown.signature() != envelope.signature())
      return wrong("is about another transaction than the one in the block");
    if (!out.peers.empty() && out.code != said->validationcode())
      return Error{fmt::format("the peers differ: {} says {}, {} says {}", out.peers.back().msp_id,
                               name_of_code(out.code), name.msp_id, name_of_code(said->validationcode()))};
    out.code = said->validationcode();
    out.peers.push_back(name);
  }
  out.verdict = name_of_code(out.code);
  if (out.code == protos::VALID && out.endorsers.empty())
    return Error{"the peers call it valid, and no endorsement of it is good"};
  if (2 * out.peers.size() > out.organisations) return done;
  return Error{fmt::format("the verdict is said by peers of {} of {} organisations, which is no majority",
                           out.peers.size(), out.organisations)};
}

Proven::Other other_of(const Transaction& transaction, crypto::MspRegistry& registry) {
  const auto creator = registry.member(transaction.creator, std::nullopt);
  return {transaction.tx_id, creator ? (*creator)->name : crypto::IdentityName{}};
}

Result<std::unique_ptr<crypto::MspRegistry>> registry_of(const std::vector<crypto::MspRoot>& roots, const char* whose) {
  if (roots.empty()) return Error{fmt::format("no authority of {} is named", whose)};
  for (const crypto::MspRoot& root : roots) {
    if (root.msp_id.empty()) return Error{fmt::format("an authority of {} has no MSP id", whose)};
    if (auto certificate = crypto::parse_certificate(root.ca_pem); !certificate)
      return Error{fmt::format("the authority of {}: {}", root.msp_id, certificate.error().what)};
  }
  return crypto::make_msp_registry(crypto::Library::libcrypto, roots);
}

}  // namespace

Result<ReceiptJudge> ReceiptJudge::from(ReceiptTrust trust) {
  // protobuf would write a line to standard error for each malformed text that a hostile receipt carries.
  google::protobuf::SetLogHandler(nullptr);
  if (trust.channel.empty()) return Error{"the channel's name is missing"};
  auto organisations = registry_of(trust.organisations, "the organisations");
  if (!organisations) return organisations.error();
  auto orderers = registry_of(trust.orderers, "the orderers");
  if (!orderers) return orderers.error();
  std::set<std::string> names;
  for (const crypto::MspRoot& root : trust.organisations) names.insert(root.msp_id);
  ReceiptJudge judge;
  judge.channel_ = std::move(trust.channel);
  judge.organisation_count_ = names.size();
  judge.organisations_ = std::move(*organisations);
  judge.orderers_ = std::move(*orderers);
  return judge;
}

Result<Proven> ReceiptJudge::verify(std::string_view bytes) const {
  const auto receipt = read_receipt(bytes);
  if (!receipt) return receipt.error();
  if (receipt->channel != channel_)
    return Error{fmt::format("it is of channel {}, not of {}", printable(receipt->channel, max_name), channel_)};
  const auto block = open_block(receipt->block);
  if (!block) return block.error();
  auto orderers = orderers_of(receipt->block, *orderers_);
  if (!orderers) return orderers.error();
  const auto at = find_transaction(*receipt, *block);
  if (!at) return at.error();
  Proven out;
  out.channel = channel_;
  out.tx_id = receipt->tx_id;
  out.block = block->number;
  out.block_hash = crypto::hex(block_header_hash(block->number, block->previous_hash, block->data_hash));
  out.orderers = std::move(*orderers);
  out.organisations = organisation_count_;
  const auto opened = open_transaction(receipt->block.data[*at]);
  if (!opened) return Error{fmt::format("transaction {}: {}", out.tx_id, opened.error().what)};
  if (auto status = read_call(block->transactions[*at], *opened, *organisations_, out); !status) return status.error();
  if (auto status = read_verdict(*receipt, opened->envelope, *organisations_, out); !status) return status.error();
  for (std::size_t i = 0; i < block->transactions.size(); ++i) {
    if (i != *at) out.others.push_back(other_of(block->transactions[i], *organisations_));
  }
  return out;
}

}  // namespace ledgerline::fabric
