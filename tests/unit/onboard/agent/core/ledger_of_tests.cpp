#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

#include "common/common.pb.h"
#include "common/msg/proto_json.hpp"
#include "peer/chaincode.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::agent::testing {
namespace {

std::string text(const crypto::Digest& digest) { return {digest.begin(), digest.end()}; }

/// The call that an honest contract answers with this event: the same message, or for control events the drones in it.
fabric::Call honest_call(const LedgerOfTests::Tx& tx) {
  Controls controls;
  Stops stops;
  if (tx.event_name == "stop" && parse_message(tx.event_payload, stops)) {
    DronesCall call;
    for (const Stop& stop : stops.stops()) call.add_drones(stop.drone());
    call.set_cut(!stops.stops().empty() && stops.stops(0).cut());
    return {tx.event_name, {call.SerializeAsString()}};
  }
  const bool other = tx.event_name == "command" || tx.event_name == "set" || tx.event_name == "stop";
  if (other || !parse_message(tx.event_payload, controls)) return {tx.event_name, {tx.event_payload}};
  EnrollCall enrolment;
  LeaseCall lease;
  for (const Control& control : controls.controls()) {
    enrolment.add_drones(control.drone());
    lease.add_drones(control.drone());
    lease.set_priority(control.priority());
    if (tx.event_name == "acquire" && control.has_delegate()) *lease.mutable_delegate() = control.delegate();
  }
  *enrolment.mutable_identity() = controls.identity();
  const bool enroll = tx.event_name == "enroll";
  return {tx.event_name, {enroll ? enrolment.SerializeAsString() : lease.SerializeAsString()}};
}

void spoil(std::string& signature) { signature.back() = static_cast<char>(signature.back() ^ 1); }

}  // namespace

fabric::Transaction LedgerOfTests::transaction(const Tx& tx) {
  const auto creator = crypto::make_test_identity(tx.creator);
  const auto endorser = crypto::make_test_identity(tx.endorser);
  const std::string nonce = "nonce" + std::to_string(next_nonce_++);
  const std::string tx_id = crypto::hex(crypto::sha256(nonce + creator.serialized));

  common::ChannelHeader channel;
  channel.set_type(3);
  channel.set_tx_id(tx_id);
  channel.set_channel_id(tx.channel);
  common::SignatureHeader signature_header;
  signature_header.set_creator(creator.serialized);
  signature_header.set_nonce(nonce);
  common::Payload payload;
  payload.mutable_header()->set_channel_header(channel.SerializeAsString());
  payload.mutable_header()->set_signature_header(signature_header.SerializeAsString());

  protos::ChaincodeProposalPayload proposal;
  const fabric::Call asked = tx.asked.value_or(honest_call(tx));
  protos::ChaincodeInvocationSpec invocation;
  protos::ChaincodeInput& input = *invocation.mutable_chaincode_spec()->mutable_input();
  input.add_args(asked.function);
  for (const std::string& arg : asked.args) input.add_args(arg);
  proposal.set_input(invocation.SerializeAsString());
  protos::ChaincodeEvent event;
  event.set_chaincode_id(tx.contract);
  event.set_tx_id(tx_id);
  event.set_event_name(tx.event_name);
  event.set_payload(tx.event_payload);
  protos::ChaincodeAction action;
  action.set_events(event.SerializeAsString());
  protos::ProposalResponsePayload response;
  response.set_proposal_hash(
      text(crypto::sha256(payload.header().channel_header() + payload.header().signature_header() +
                          (tx.spoil.proposal_hash ? std::string("another call") : proposal.SerializeAsString()))));
  response.set_extension(action.SerializeAsString());

  protos::ChaincodeActionPayload action_payload;
  action_payload.set_chaincode_proposal_payload(proposal.SerializeAsString());
  auto* endorsed = action_payload.mutable_action();
  endorsed->set_proposal_response_payload(response.SerializeAsString());
  auto* endorsement = endorsed->add_endorsements();
  endorsement->set_endorser(endorser.serialized);
  std::string endorsement_signature =
      *endorser.signer->sign(endorsed->proposal_response_payload() + endorser.serialized);
  if (tx.spoil.endorsement_signature) spoil(endorsement_signature);
  endorsement->set_signature(endorsement_signature);

  protos::Transaction transaction;
  transaction.add_actions()->set_payload(action_payload.SerializeAsString());
  payload.set_data(transaction.SerializeAsString());

  fabric::Transaction out;
  out.tx_id = tx_id;
  out.channel = tx.channel;
  out.contract = tx.contract;
  out.code = tx.code;
  out.by_flag = tx.by_flag;
  out.creator = creator.serialized;
  out.function = asked.function;
  out.args = asked.args;
  out.event_name = tx.event_name;
  out.event_payload = tx.event_payload;
  out.payload = payload.SerializeAsString();
  out.signature = *creator.signer->sign(out.payload);
  if (tx.spoil.creator_signature) spoil(out.signature);
  out.response_payload = endorsed->proposal_response_payload();
  out.endorsements = {{endorser.serialized, endorsement_signature}};
  return out;
}

fabric::Block LedgerOfTests::block(const std::vector<Tx>& transactions) {
  fabric::Block block;
  block.number = next_number_++;
  block.previous_hash = previous_hash_;
  std::string data;
  for (const Tx& tx : transactions) {
    block.transactions.push_back(transaction(tx));
    data += block.transactions.back().payload;
  }
  block.data_hash = text(crypto::sha256(data));
  previous_hash_ = fabric::block_header_hash(block.number, block.previous_hash, block.data_hash);
  return block;
}

Stop stop_of(const std::string& drone, bool cut) {
  Stop stop;
  stop.set_drone(drone);
  *stop.mutable_stopper() = to_message(LedgerOfTests::operator_name());
  stop.set_cut(cut);
  return stop;
}

Control control(const std::string& drone, std::uint64_t epoch) {
  Control record;
  record.set_drone(drone);
  record.set_epoch(epoch);
  *record.mutable_owner() = to_message({"Org1MSP", "CN=User1@org1.ledgerline"});
  *record.mutable_holder() = to_message(LedgerOfTests::operator_name());
  Grant& all = *record.add_grants();
  all.mutable_to()->set_msp_id("Org2MSP");
  all.set_fly(true);
  all.set_max_priority(9);
  Grant& one = *record.add_grants();
  *one.mutable_to() = to_message(LedgerOfTests::operator_name());
  one.set_cut(true);
  return record;
}

}  // namespace ledgerline::agent::testing
