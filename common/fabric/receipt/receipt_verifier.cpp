#include "common/fabric/receipt/receipt_verifier.hpp"

#include <fmt/format.h>
#include <google/protobuf/stubs/logging.h>

#include <algorithm>
#include <optional>
#include <set>

#include "common/base/text.hpp"
#include "common/common.pb.h"
#include "common/fabric/receipt/receipt.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"

namespace ledgerline::fabric {

namespace {

constexpr std::size_t max_name = 200;  // of what others chose, in a message

using Names = std::vector<crypto::IdentityName>;
using Role = ReceiptProof::Certificate::Role;

std::string text_of(const crypto::IdentityName& name) { return name.msp_id + " " + name.subject; }

/// Tells of a certificate by which something is proven; `used_s`: see there.
Status note(Role role, const Members::Found& found, std::int64_t used_s, ReceiptProof& out) {
  const auto certificate = crypto::parse_certificate(found.member->pem);
  if (!certificate) return certificate.error();
  out.certificates.push_back(
      {role, found.member->name, certificate->not_before_s, certificate->not_after_s, used_s, found.revoked});
  return done;
}

/// Behind a refusal: those of a role whose word does not count. Empty where there are none.
std::string not_counted(Role role, const ReceiptProof& out) {
  std::string text;
  for (const ReceiptProof::Certificate& one : out.certificates) {
    if (one.role != role || !one.revoked) continue;
    text += (text.empty() ? "; revoked, so not counted: " : ", ") + text_of(one.who);
  }
  return text;
}

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

Status read_orderers(const Receipt::Block& block, const Members& members, ReceiptProof& out) {
  const auto wrong = [&](const std::string& why) { return Error{fmt::format("block {}: {}", block.number, why)}; };
  const std::string header = block_header_bytes(block.number, block.previous_hash, block.data_hash);
  Names all;
  for (const Receipt::Signature& one : block.orderers) {
    common::SignatureHeader who;
    if (!who.ParseFromString(one.signer)) return wrong("who signed it cannot be read");
    const auto found = members.find(who.creator());
    if (!found) return wrong("who signed it is no orderer that you named: " + found.error().message);
    const crypto::IdentityName& name = found->member->name;
    if (!found->member->orderer) return wrong(fmt::format("{} signed it and is no orderer", name.subject));
    if (std::ranges::find(all, name) != all.end()) return wrong(fmt::format("{} signed it twice", name.subject));
    if (!found->member->verifier->verify(block.orderers_value + one.signer + header, one.signature))
      return wrong(fmt::format("the signature of {} is not of this block", name.subject));
    all.push_back(name);
    if (auto status = note(Role::orderer, *found, out.timestamp_ns / ns_per_s, out); !status) return status;
    if (!found->revoked) out.orderers.push_back(name);
  }
  if (out.orderers.empty()) return wrong("no orderer has signed it" + not_counted(Role::orderer, out));
  return done;
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
Status read_endorsers(const Transaction& transaction, const OpenedTransaction& opened, const Members& members,
                      ReceiptProof& out) {
  const common::Header& header = opened.payload.header();
  if (opened.response.proposal_hash() !=
      proposal_hash(header.channel_header(), header.signature_header(), opened.action.chaincode_proposal_payload()))
    return done;
  for (const Endorsement& one : transaction.endorsements) {
    const auto found = members.find(one.endorser);
    if (!found || !found->member->peer ||
        !found->member->verifier->verify(transaction.response_payload + one.endorser, one.signature))
      continue;
    out.endorsers.push_back(found->member->name);
    if (auto status = note(Role::endorser, *found, out.timestamp_ns / ns_per_s, out); !status) return status;
  }
  return done;
}

/// Creator and call into `out`: what the creator signed.
Status read_call(const Transaction& transaction, const OpenedTransaction& opened, const Members& members,
                 ReceiptProof& out) {
  const auto wrong = [&](const std::string& why) { return Error{fmt::format("transaction {}: {}", out.tx_id, why)}; };
  common::SignatureHeader header;
  if (!header.ParseFromString(opened.payload.header().signature_header())) return wrong("its creator cannot be read");
  if (out.tx_id != transaction_id(header)) return wrong("its id is not of its creator");
  const auto creator = members.find(header.creator());
  if (!creator) return wrong("its creator is nobody of the organisations that you named: " + creator.error().message);
  if (!creator->member->verifier->verify(opened.envelope.payload(), opened.envelope.signature()))
    return wrong("its creator's signature is wrong");
  out.creator = creator->member->name;
  out.contract = transaction.contract;
  out.function = transaction.function;
  out.arguments = transaction.args;
  out.timestamp_ns = transaction.timestamp_ns;
  if (auto status = note(Role::creator, *creator, out.timestamp_ns / ns_per_s, out); !status) return status;
  return read_endorsers(transaction, opened, members, out);
}

/// The verdict into `out`: what peers signed.
Status read_verdict(const Receipt& receipt, const common::Envelope& envelope, const Members& members,
                    ReceiptProof& out) {
  const auto question = read_question(receipt.question, receipt.channel, receipt.tx_id);
  if (!question) return question.error();
  std::string last;  // organisation
  for (const Receipt::Answer& answer : receipt.answers) {
    const auto found = members.find(answer.endorsement.signer);
    if (!found) return Error{"who answered is no peer of the organisations that you named: " + found.error().message};
    const crypto::IdentityName& name = found->member->name;
    const auto wrong = [&](const std::string& why) {
      return Error{fmt::format("the answer of {}: it {}", text_of(name), why)};
    };
    if (!found->member->peer) return wrong("is not of a peer");
    if (last >= name.msp_id) return wrong("is not the only one of its organisation, or not at its place");
    if (!found->member->verifier->verify(answer.payload + answer.endorsement.signer, answer.endorsement.signature))
      return wrong("has a signature that is not its own");
    const auto said = read_answer(answer.payload, question->hash);
    if (!said) return wrong(said.error().message);
    const common::Envelope& shown = said->transactionenvelope();
    if (shown.payload() != envelope.payload() || shown.signature() != envelope.signature())
      return wrong("is about another transaction than the one in the block");
    if (!last.empty() && out.code != said->validationcode())
      return Error{fmt::format("the peers differ: {} says {}, {} says {}", last, name_of_code(out.code), name.msp_id,
                               name_of_code(said->validationcode()))};
    out.code = said->validationcode();
    last = name.msp_id;
    if (auto status = note(Role::peer, *found, question->time_s, out); !status) return status;
    if (!found->revoked) out.peers.push_back(name);
  }
  out.verdict = name_of_code(out.code);
  if (out.code == protos::VALID && out.endorsers.empty())
    return Error{"the peers call it valid, and no endorsement of it is good"};
  if (2 * out.peers.size() > out.organisations) return done;
  return Error{fmt::format("the verdict is said by peers of {} of {} organisations, which is no majority{}",
                           out.peers.size(), out.organisations, not_counted(Role::peer, out))};
}

ReceiptProof::Other other_of(const Transaction& transaction, const Members& members) {
  const auto creator = members.find(transaction.creator);
  return {transaction.tx_id, creator ? creator->member->name : crypto::IdentityName{}};
}

Status check_roots(const std::vector<crypto::MspRoot>& roots, const char* whose) {
  if (roots.empty()) return Error{fmt::format("no authority of {} is named", whose)};
  for (const crypto::MspRoot& root : roots) {
    if (root.msp_id.empty()) return Error{fmt::format("an authority of {} has no MSP id", whose)};
    if (auto certificate = crypto::parse_certificate(root.ca_pem); !certificate)
      return Error{fmt::format("the authority of {}: {}", root.msp_id, certificate.error().message)};
  }
  return done;
}

}  // namespace

Result<ReceiptVerifier> ReceiptVerifier::from(ReceiptTrust trust) {
  // protobuf would write a line to standard error for each malformed text that a hostile receipt carries.
  google::protobuf::SetLogHandler(nullptr);
  if (trust.channel.empty()) return Error{"the channel's name is missing"};
  if (auto status = check_roots(trust.organisations, "the organisations"); !status) return status.error();
  if (auto status = check_roots(trust.orderers, "the orderers"); !status) return status.error();
  ReceiptVerifier verifier;
  std::vector<crypto::MspRoot> all = trust.organisations;
  all.insert(all.end(), trust.orderers.begin(), trust.orderers.end());
  std::vector<std::string> texts{std::move(trust.revocation_lists_pem)};
  for (const crypto::MspRoot& root : all) texts.push_back(root.revocation_lists_pem);
  std::string lists;
  for (const std::string& text : texts) {
    if (text.empty()) continue;
    const auto read = crypto::read_revocation_lists(text, all);
    if (!read) return read.error();
    verifier.lists_.insert(verifier.lists_.end(), read->begin(), read->end());
    lists += text + "\n";
  }
  std::set<std::string> names, listless;
  for (const crypto::MspRoot& root : trust.organisations) names.insert(root.msp_id);
  for (const crypto::MspRoot& root : all) listless.insert(root.msp_id);
  for (const crypto::RevocationList& list : verifier.lists_) listless.erase(list.msp_id);
  verifier.channel_ = std::move(trust.channel);
  verifier.organisation_count_ = names.size();
  verifier.without_list_.assign(listless.begin(), listless.end());
  verifier.organisations_ = std::make_unique<Members>(std::move(trust.organisations), lists);
  verifier.orderers_ = std::make_unique<Members>(std::move(trust.orderers), lists);
  return verifier;
}

Result<ReceiptProof> ReceiptVerifier::verify(std::string_view bytes) const {
  const auto receipt = read_receipt(bytes);
  if (!receipt) return receipt.error();
  if (receipt->channel != channel_)
    return Error{fmt::format("it is of channel {}, not of {}", printable(receipt->channel, max_name), channel_)};
  const auto block = open_block(receipt->block);
  if (!block) return block.error();
  const auto at = find_transaction(*receipt, *block);
  ReceiptProof out;
  out.channel = channel_;
  out.tx_id = receipt->tx_id;
  out.block = block->number;
  out.block_hash = crypto::hex(block_header_hash(block->number, block->previous_hash, block->data_hash));
  out.organisations = organisation_count_;
  out.revocation_lists = lists_;
  out.without_list = without_list_;
  if (at) out.timestamp_ns = block->transactions[*at].timestamp_ns;
  if (auto status = read_orderers(receipt->block, *orderers_, out); !status) return status.error();
  if (!at) return at.error();
  const auto opened = open_transaction(receipt->block.data[*at]);
  if (!opened) return Error{fmt::format("transaction {}: {}", out.tx_id, opened.error().message)};
  if (auto status = read_call(block->transactions[*at], *opened, *organisations_, out); !status) return status.error();
  if (auto status = read_verdict(*receipt, opened->envelope, *organisations_, out); !status) return status.error();
  for (std::size_t i = 0; i < block->transactions.size(); ++i) {
    if (i != *at) out.others.push_back(other_of(block->transactions[i], *organisations_));
  }
  return out;
}

Members::Members(std::vector<crypto::MspRoot> roots, const std::string& lists_pem) {
  for (crypto::MspRoot& root : roots) root.revocation_lists_pem.clear();
  all_ = crypto::make_msp_registry(crypto::Library::libcrypto, roots);
  if (lists_pem.empty()) return;
  for (crypto::MspRoot& root : roots) root.revocation_lists_pem = lists_pem;
  not_revoked_ = crypto::make_msp_registry(crypto::Library::libcrypto, std::move(roots), crypto::ListsFrom::hand);
}

Result<Members::Found> Members::find(std::string_view serialized) const {
  auto member = all_->member(serialized, std::nullopt);
  if (!member) return member.error();
  return Found{std::move(*member), not_revoked_ && !not_revoked_->member(serialized, std::nullopt)};
}

}  // namespace ledgerline::fabric
