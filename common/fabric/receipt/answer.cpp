#include "common/fabric/receipt/answer.hpp"

#include <fmt/format.h>

#include "common/base/text.hpp"
#include "common/common.pb.h"
#include "common/fabric/receipt/receipt.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"

namespace ledgerline::fabric {

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

}  // namespace ledgerline::fabric
