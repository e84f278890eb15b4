#include "common/fabric/receipt/answer.hpp"

#include <fmt/format.h>

#include "common/base/printable.hpp"
#include "common/common.pb.h"
#include "common/fabric/receipt/receipt.hpp"
#include "common/fabric/tx/form.hpp"
#include "peer/chaincode.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"

namespace ledgerline::fabric {
namespace {

/// What the asker chose of a question; all else of it follows.
struct Asker {
  common::SignatureHeader who;
  std::int64_t time_s = 0;
  std::int32_t time_ns = 0;
};

/// The question in its one form, that of make_proposal: a receipt of today is read so for ever.
std::string question_of(const Asker& asker, const std::string& channel, const std::string& tx_id) {
  protos::ChaincodeHeaderExtension extension;
  extension.mutable_chaincode_id()->set_name(chain_contract);
  common::ChannelHeader channel_header;
  channel_header.set_type(common::ENDORSER_TRANSACTION);
  channel_header.set_channel_id(channel);
  channel_header.mutable_timestamp()->set_seconds(asker.time_s);
  channel_header.mutable_timestamp()->set_nanos(asker.time_ns);
  channel_header.set_tx_id(transaction_id(asker.who));
  channel_header.set_extension(extension.SerializeAsString());
  common::SignatureHeader signature_header;
  signature_header.set_creator(asker.who.creator());
  signature_header.set_nonce(asker.who.nonce());
  common::Header header;
  header.set_channel_header(channel_header.SerializeAsString());
  header.set_signature_header(signature_header.SerializeAsString());
  protos::ChaincodeInvocationSpec invocation;
  protos::ChaincodeSpec& spec = *invocation.mutable_chaincode_spec();
  spec.set_type(protos::ChaincodeSpec::NODE);
  spec.mutable_chaincode_id()->set_name(chain_contract);
  for (const std::string& arg : {std::string(verdict_function), channel, tx_id}) spec.mutable_input()->add_args(arg);
  protos::ChaincodeProposalPayload payload;
  payload.set_input(invocation.SerializeAsString());
  protos::Proposal proposal;
  proposal.set_header(header.SerializeAsString());
  proposal.set_payload(payload.SerializeAsString());
  return proposal.SerializeAsString();
}

}  // namespace

Result<std::string> question_hash(std::string_view question, const std::string& channel, const std::string& tx_id) {
  protos::Proposal proposal;
  common::Header header;
  common::ChannelHeader channel_header;
  Asker asker;
  if (!parse(proposal, question) || !parse(header, proposal.header()) ||
      !parse(channel_header, header.channel_header()) || !parse(asker.who, header.signature_header()))
    return Error{"the question to the peers is malformed"};
  asker.time_s = channel_header.timestamp().seconds();
  asker.time_ns = channel_header.timestamp().nanos();
  if (question_of(asker, channel, tx_id) != question)
    return Error{"the peers were not asked for this transaction's verdict"};
  return proposal_hash(header.channel_header(), header.signature_header(), proposal.payload());
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
