#include "chaincode/node/core/tx/messages.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "peer/chaincode_event.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"
#include "tests/fuzz/entry.hpp"
#include "tests/unit/chaincode/node/core/fake_network.hpp"

/// The node's core: proposals, envelopes, signed requests, and blocks from disk. Each way in has two entries or more:
/// bytes as an outsider sends them, and inner messages spoilt by a member who then signs them properly.
namespace ledgerline::fuzz::node_part {
namespace {

using namespace node;

Outcome outcome_of_reply(const Reply& reply) {
  if (reply.code == Code::ok) return accepted();
  const std::string& why = reply.detail.empty() ? reply.message : reply.detail;
  return refused(reply.message.empty() ? "" : why);
}

/// Enrolled: tello1; operator with the lease: pilot.
std::unique_ptr<FakeNetwork> make_network() {
  CoreConfig settings;  // hardly anything here is valid: nobody is kept out for it
  settings.invalid_of_identity = settings.invalid_of_organisation = 1'000'000'000;
  auto net = std::make_unique<FakeNetwork>(settings);
  net->submit(net->admin1, "enroll", enroll_call(net->host.name, {"tello1"}));
  net->submit(net->admin2, "enroll", enroll_call(net->pilot.name, {}, OPERATOR));
  net->submit(net->admin1, "grant", grant_call("Org2MSP", {"tello1"}));
  net->submit(net->host, "set", note("tello1/a"));
  return net;
}

const crypto::SigningIdentity& member(const FakeNetwork& net, const std::string& creator) {
  for (const crypto::SigningIdentity* one : {&net.admin1, &net.admin2, &net.pilot}) {
    if (one->serialized == creator) return *one;
  }
  return net.host;
}

template <typename Message>
bool read(Message& message, std::string_view bytes) {
  return message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

/// Gives the header the transaction id that belongs to its nonce and creator; a new nonce where one is given.
void right_id(common::Header& header, const std::string& nonce, std::string& creator) {
  common::ChannelHeader channel;
  common::SignatureHeader signature;
  if (!read(channel, header.channel_header()) || !read(signature, header.signature_header())) return;
  if (!nonce.empty()) signature.set_nonce(nonce);
  channel.set_tx_id(fabric::transaction_id(signature));
  creator = signature.creator();
  header.set_channel_header(channel.SerializeAsString());
  header.set_signature_header(signature.SerializeAsString());
}

class ProposalEntry final : public Entry {
 public:
  using Method = Reply (NodeCore::*)(std::string_view, Now);
  ProposalEntry(Method method, bool signed_again) : method_(method), signed_again_(signed_again) {}

  std::vector<std::string> seeds() override {
    FakeNetwork& net = *net_;
    std::vector<std::string> all{
        net.propose(net.host, "set", note("tello1/b")).signed_proposal,
        net.propose(net.admin1, "enroll", enroll_call(net.host.name, {"tello2"})).signed_proposal,
        net.propose(net.pilot, "acquire", R"({"drones":["tello1"],"priority":2})").signed_proposal,
        net.propose(net.pilot, "get", "tello1/*").signed_proposal,
        net.propose(net.pilot, "history", "tello1/a").signed_proposal};
    if (!signed_again_) return all;
    for (std::string& one : all) {
      protos::SignedProposal outer;
      (void)read(outer, one);
      one = outer.proposal_bytes();
    }
    return all;
  }

  Outcome feed(std::string_view bytes) override {
    NodeCore& core = *net_->core;
    const Reply reply = (core.*method_)(signed_again_ ? sign(bytes) : std::string(bytes), net_->now);
    if (method_ != Method(&NodeCore::process_proposal) || reply.code != Code::ok) return outcome_of_reply(reply);
    protos::ProposalResponse response;
    if (!read(response, reply.bytes)) return refused("");
    return response.response().status() >= 400 ? refused(response.response().message()) : accepted();
  }

 private:
  std::string sign(std::string_view bytes) const {
    protos::Proposal proposal;
    common::Header header;
    std::string creator;
    protos::SignedProposal outer;
    outer.set_proposal_bytes(bytes.data(), bytes.size());
    if (read(proposal, bytes) && read(header, proposal.header())) {
      right_id(header, "", creator);
      proposal.set_header(header.SerializeAsString());
      outer.set_proposal_bytes(proposal.SerializeAsString());
    }
    outer.set_signature(*member(*net_, creator).signer->sign(outer.proposal_bytes()));
    return outer.SerializeAsString();
  }

  Method method_;
  bool signed_again_;
  std::unique_ptr<FakeNetwork> net_ = make_network();
};

/// Orders, cuts and applies; whatever is taken for ordering gets a code, is in a block that others can read, and does
/// not keep the next one out.
class OrderEntry final : public Entry {
 public:
  /// Whose signatures are made right again.
  enum class Signed { nobody, client, client_and_peers };
  explicit OrderEntry(Signed by) : by_(by) {}

  std::vector<std::string> seeds() override { return inputs(); }
  std::vector<std::string> probes() override {
    net_->restart();  // the chain with all that was ordered is taken again
    return inputs();
  }

  Outcome feed(std::string_view bytes) override {
    FakeNetwork& net = *net_;
    net.now.monotonic_ns += ns_per_ms;
    const Reply reply = net.core->order(by_ == Signed::nobody ? std::string(bytes) : sign(bytes), net.now);
    if (reply.code != Code::ok) return outcome_of_reply(reply);
    const std::size_t height = net.chain.size();
    const std::vector<int> codes = net.commit();
    if (codes.size() != 1 || net.chain.size() != height + 1 || net.core->height() != height + 1) return refused("");
    if (!protos::TxValidationCode_IsValid(codes[0]) || codes[0] == protos::NOT_VALIDATED) return refused("");
    if (by_ != Signed::client_and_peers && !fabric::decode_block(net.chain.back())) return refused("");
    if (codes[0] != protos::VALID) {
      return refused(protos::TxValidationCode_Name(static_cast<protos::TxValidationCode>(codes[0])));
    }
    // A peer that lies may have written anything: what follows needs a good state.
    if (by_ == Signed::client_and_peers) {
      const int used = net_->nonces;
      net_ = make_network();
      net_->nonces += used;  // no proposal twice
    }
    return accepted();
  }

 private:
  std::vector<std::string> inputs() {
    FakeNetwork& net = *net_;
    std::vector<std::string> all{net.endorsed(net.host, "set", note("tello1/b")),
                                 net.endorsed(net.host, "set", note("Org1MSP/c")),
                                 net.endorsed(net.pilot, "get", "tello1/a")};
    if (by_ == Signed::nobody) return all;
    for (std::string& one : all) {
      common::Envelope envelope;
      (void)read(envelope, one);
      one = envelope.payload();
    }
    return all;
  }

  std::string sign(std::string_view bytes) {
    common::Payload payload;
    protos::Transaction transaction;
    std::string creator;
    common::Envelope envelope;
    envelope.set_payload(bytes.data(), bytes.size());
    if (read(payload, bytes) && read(transaction, payload.data())) {
      if (by_ == Signed::client_and_peers) {
        // A transaction of its own each time: one that is known is looked at no further.
        right_id(*payload.mutable_header(), "nonce of the campaign " + std::to_string(++nonces_), creator);
        endorse_again(payload, transaction);
        payload.set_data(transaction.SerializeAsString());
      } else {
        right_id(*payload.mutable_header(), "", creator);
      }
      envelope.set_payload(payload.SerializeAsString());
    }
    envelope.set_signature(*member(*net_, creator).signer->sign(envelope.payload()));
    return envelope.SerializeAsString();
  }

  static void endorse_again(const common::Payload& payload, protos::Transaction& transaction) {
    protos::ChaincodeActionPayload action;
    protos::ProposalResponsePayload response;
    if (transaction.actions_size() < 1 || !read(action, transaction.actions(0).payload()) ||
        !read(response, action.action().proposal_response_payload())) {
      return;
    }
    transaction.mutable_actions(0)->set_header(payload.header().signature_header());
    response.set_proposal_hash(fabric::proposal_hash(
        payload.header().channel_header(), payload.header().signature_header(), action.chaincode_proposal_payload()));
    right_event(*response.mutable_extension(), payload);
    const std::string result = response.SerializeAsString();
    action.mutable_action()->set_proposal_response_payload(result);
    action.mutable_action()->clear_endorsements();
    for (const std::string organisation : {"Org1MSP", "Org2MSP"}) {
      const auto peer = crypto::make_test_identity({organisation, "CN=peer0"});
      protos::Endorsement& endorsement = *action.mutable_action()->add_endorsements();
      endorsement.set_endorser(peer.serialized);
      endorsement.set_signature(*peer.signer->sign(result + peer.serialized));
    }
    transaction.mutable_actions(0)->set_payload(action.SerializeAsString());
  }

  /// The event names its transaction.
  static void right_event(std::string& extension, const common::Payload& payload) {
    protos::ChaincodeAction action;
    protos::ChaincodeEvent event;
    common::ChannelHeader header;
    if (!read(action, extension) || action.events().empty() || !read(event, action.events()) ||
        !read(header, payload.header().channel_header())) {
      return;
    }
    event.set_tx_id(header.tx_id());
    action.set_events(event.SerializeAsString());
    extension = action.SerializeAsString();
  }

  Signed by_;
  int nonces_ = 0;
  std::unique_ptr<FakeNetwork> net_ = make_network();
};

/// The last block of a chain, damaged on disk. What is refused changes nothing: the right block is taken after it.
class ReplayEntry final : public Entry {
 public:
  /// `sealed`: number and hashes are made right again.
  explicit ReplayEntry(bool sealed) : sealed_(sealed) {}
  std::vector<std::string> seeds() override { return {net_->chain.back()}; }

  Outcome feed(std::string_view bytes) override {
    NodeCore core(net_->config, crypto::make_test_registry({"Org1MSP", "Org2MSP", "Org3MSP"}), peers_,
                  crypto::make_test_identity({"OrdererMSP", "CN=orderer"}),
                  [](std::uint64_t) -> Result<std::string> { return Error{"not here"}; });
    for (std::size_t i = 0; i + 1 < net_->chain.size(); ++i) {
      if (!core.replay(net_->chain[i])) return refused("");
    }
    const std::uint64_t height = core.height();
    const Status taken = core.replay(sealed_ ? seal(bytes) : std::string(bytes));
    if (core.height() != height + (taken ? 1 : 0)) return refused("");
    if (!taken && !core.replay(net_->chain.back())) return refused("");
    return outcome_of(taken);
  }

 private:
  std::string seal(std::string_view bytes) const {
    common::Block block, good;
    if (!read(block, bytes) || !read(good, net_->chain.back())) return std::string(bytes);
    *block.mutable_header() = good.header();
    block.mutable_header()->set_data_hash(fabric::data_hash(block.data()));
    return block.SerializeAsString();
  }

  bool sealed_;
  std::unique_ptr<FakeNetwork> net_ = make_network();
  std::vector<crypto::SigningIdentity> peers_{crypto::make_test_identity({"Org1MSP", "CN=peer0"})};
};

/// CommitStatus, ChaincodeEvents and Deliver: who asks, what, and a signature; as a protos.Endorsement beside a
/// message.
class SignerEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    std::vector<std::string> all;
    for (const crypto::SigningIdentity* who : {&net_->host, &net_->pilot}) {
      protos::Endorsement one;
      one.set_endorser(who->serialized);
      one.set_signature(*who->signer->sign("a request"));
      all.push_back(one.SerializeAsString());
    }
    return all;
  }
  Outcome feed(std::string_view bytes) override {
    protos::Endorsement one;
    if (!read(one, bytes)) return dropped();
    return outcome_of(net_->core->check_signer(one.endorser(), "a request", one.signature(), net_->now));
  }

 private:
  std::unique_ptr<FakeNetwork> net_ = make_network();
};

Registered proposal(const std::string& name, ProposalEntry::Method method, bool signed_again) {
  return {"node." + name, Kind::protobuf, [=] { return std::make_unique<ProposalEntry>(method, signed_again); }};
}
Registered order(const std::string& name, OrderEntry::Signed by, double least_accepted) {
  return {"node." + name, Kind::protobuf, [=] { return std::make_unique<OrderEntry>(by); }, 0.2, least_accepted};
}
const Registration endorse(proposal("endorse", &NodeCore::endorse, false));
const Registration endorse_signed(proposal("endorse_signed", &NodeCore::endorse, true));
const Registration evaluate(proposal("evaluate", &NodeCore::evaluate, false));
const Registration evaluate_signed(proposal("evaluate_signed", &NodeCore::evaluate, true));
const Registration process(proposal("process_proposal", &NodeCore::process_proposal, false));
const Registration process_signed(proposal("process_proposal_signed", &NodeCore::process_proposal, true));
// What is valid is valid once: after it, its id is known.
const Registration order_outer(order("order", OrderEntry::Signed::nobody, 0));
const Registration order_signed(order("order_signed", OrderEntry::Signed::client, 0));
const Registration order_endorsed(order("order_endorsed", OrderEntry::Signed::client_and_peers, 0.002));
const Registration replay({"node.replay", Kind::protobuf, [] { return std::make_unique<ReplayEntry>(false); }});
const Registration replay_sealed({"node.replay_sealed", Kind::protobuf,
                                  [] { return std::make_unique<ReplayEntry>(true); }, 0.05});
const Registration signer({"node.check_signer", Kind::protobuf, [] { return std::make_unique<SignerEntry>(); }});

}  // namespace
}  // namespace ledgerline::fuzz::node_part
