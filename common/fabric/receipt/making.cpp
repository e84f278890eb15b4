#include <fmt/format.h>

#include <map>

#include "common/base/text.hpp"
#include "common/common.pb.h"
#include "common/fabric/receipt/answer.hpp"
#include "common/fabric/receipt/receipt.hpp"
#include "msp/identities.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"

namespace ledgerline::fabric {
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
