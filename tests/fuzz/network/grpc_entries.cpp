#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <condition_variable>
#include <mutex>

#include "common/fabric/client/connection.hpp"
#include "gateway/gateway.pb.h"
#include "orderer/ab.pb.h"
#include "peer/events.pb.h"
#include "peer/proposal.pb.h"
#include "tests/fuzz/entry.hpp"
#include "tests/unit/chaincode/node/server/raw_call.hpp"
#include "tests/unit/chaincode/node/server/served_node.hpp"

/// Every method of the node over its TLS endpoint: any bytes as a request; and requests that are spoilt and then
/// signed, where a signature would end the matter before anything else is read. What the core makes of signed proposals
/// and transactions is in node_entries.cpp.
namespace ledgerline::fuzz::grpc_part {
namespace {

using std::chrono::milliseconds;

const std::string gateway_service = "/gateway.Gateway/", blocks_service = "/protos.Deliver/",
                  ordering_service = "/orderer.AtomicBroadcast/";

/// One node for all entries of the program.
node::ServedNode& served() {
  static node::ServedNode served;
  return served;
}

struct Answer {
  std::string message;  ///< the first one
  bool answered = false;
  grpc::Status status;
};

/// A call to its first answer or its end.
Answer call(const std::string& method, const std::string& request, milliseconds deadline) {
  static const std::shared_ptr<grpc::Channel> channel = served().connect();
  std::mutex mutex;
  std::condition_variable ended;
  Answer answer;
  bool done = false;
  node::RawCall::start(
      channel, method, request, deadline,
      [&](const std::string& message) {
        const std::lock_guard lock(mutex);
        if (!answer.answered) answer.message = message;
        answer.answered = true;
        return false;
      },
      [&](const grpc::Status& status) {
        const std::lock_guard lock(mutex);
        answer.status = status;
        done = true;
        ended.notify_one();
      });
  std::unique_lock lock(mutex);
  ended.wait(lock, [&] { return done; });
  return answer;
}

/// Does the answer refuse? Empty: no.
using Refusal = std::function<std::string(const std::string& message)>;

std::string no_refusal(const std::string&) { return {}; }

template <typename Response>
std::string status_refusal(const std::string& message) {
  Response response;
  if (!response.ParseFromString(message)) return "an answer that does not parse";
  if (response.Type_case() != Response::kStatus || response.status() == common::SUCCESS) return {};
  return "status " + common::Status_Name(response.status());
}

std::string broadcast_refusal(const std::string& message) {
  orderer::BroadcastResponse response;
  if (!response.ParseFromString(message)) return "an answer that does not parse";
  return response.status() == common::SUCCESS ? "" : response.info();
}

std::string proposal_refusal(const std::string& message) {
  protos::ProposalResponse response;
  if (!response.ParseFromString(message)) return "an answer that does not parse";
  return response.response().status() < 400 ? "" : response.response().message();
}

class Method final : public Entry {
 public:
  /// `wrap` makes the request of an input; by default the input is the request.
  using Wrap = std::function<std::string(std::string_view)>;
  Method(std::string name, std::vector<std::string> seeds, Refusal refusal, Wrap wrap = {})
      : name_(std::move(name)), seeds_(std::move(seeds)), refusal_(std::move(refusal)), wrap_(std::move(wrap)) {}

  std::vector<std::string> seeds() override { return seeds_; }

  Outcome feed(std::string_view bytes) override {
    // A good question about what is not there yet waits for it, which is no refusal; a valid one has its answer at
    // once.
    const bool valid = std::find(seeds_.begin(), seeds_.end(), bytes) != seeds_.end();
    const bool at_once = valid || !may_wait_;
    const Answer answer =
        call(name_, wrap_ ? wrap_(bytes) : std::string(bytes), at_once ? milliseconds(20'000) : milliseconds(5));
    if (answer.answered) {
      const std::string why = refusal_(answer.message);
      return why.empty() ? accepted() : refused(why);
    }
    const bool waits = answer.status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED;
    if (waits) return at_once ? refused("") : accepted();
    // What a client shows: the detail, or else the message.
    const std::string shown = fabric::describe(answer.status);
    return refused(answer.status.error_message().empty() || shown.empty() ? "" : shown);
  }

 private:
  const std::string name_;
  const bool may_wait_ = name_.find("CommitStatus") != std::string::npos ||
                         name_.find("ChaincodeEvents") != std::string::npos ||
                         name_.find("Deliver") != std::string::npos;
  const std::vector<std::string> seeds_;
  const Refusal refusal_;
  const Wrap wrap_;
};

const crypto::SigningIdentity& user() {
  static const crypto::SigningIdentity user = served().user(1, "User1");
  return user;
}
std::string signature_of(const std::string& bytes) { return *user().signer->sign(bytes); }

fabric::Proposal proposal(const std::string& function, const std::string& argument) {
  return *fabric::make_proposal(user(), {}, {function, {argument}}, realtime_ns(), crypto::random_bytes(24));
}
std::string signed_proposal() {
  return proposal("set", R"({"id":"tello1/note","msgType":"t","msgData":"AAAA"})").signed_proposal;
}

std::string endorse_request() {
  gateway::EndorseRequest request;
  request.set_channel_id("teleop");
  request.mutable_proposed_transaction()->ParseFromString(signed_proposal());
  return request.SerializeAsString();
}
std::string evaluate_request() {
  gateway::EvaluateRequest request;
  request.set_channel_id("teleop");
  request.mutable_proposed_transaction()->ParseFromString(proposal("get", "control/tello1").signed_proposal);
  return request.SerializeAsString();
}
std::string envelope() {
  gateway::EndorseResponse response;
  response.ParseFromString(call(gateway_service + "Endorse", endorse_request(), milliseconds(20'000)).message);
  return *fabric::sign_envelope(user(), response.prepared_transaction().SerializeAsString());
}
std::string submit_request() {
  gateway::SubmitRequest request;
  request.set_channel_id("teleop");
  request.mutable_prepared_transaction()->ParseFromString(envelope());
  return request.SerializeAsString();
}

std::string status_request() {
  // Of a transaction that is committed.
  const std::string request = submit_request();
  (void)call(gateway_service + "Submit", request, milliseconds(20'000));
  gateway::SubmitRequest submitted;
  common::Payload payload;
  common::ChannelHeader header;
  submitted.ParseFromString(request);
  payload.ParseFromString(submitted.prepared_transaction().payload());
  header.ParseFromString(payload.header().channel_header());
  gateway::CommitStatusRequest status;
  status.set_transaction_id(header.tx_id());
  status.set_channel_id("teleop");
  status.set_identity(user().serialized);
  return status.SerializeAsString();
}
std::string sign_status(std::string_view bytes) {
  gateway::SignedCommitStatusRequest request;
  request.set_request(std::string(bytes));
  request.set_signature(signature_of(request.request()));
  return request.SerializeAsString();
}

std::string events_request() {
  // From the newest block that has an event: the node sends ahead what the connection takes.
  const Answer committed = call(gateway_service + "CommitStatus", sign_status(status_request()), milliseconds(20'000));
  gateway::CommitStatusResponse status;
  status.ParseFromString(committed.message);
  gateway::ChaincodeEventsRequest request;
  request.set_channel_id("teleop");
  request.set_chaincode_id("ledgerline");
  request.set_identity(user().serialized);
  request.mutable_start_position()->mutable_specified()->set_number(status.block_number());
  return request.SerializeAsString();
}
std::string sign_events(std::string_view bytes) {
  gateway::SignedChaincodeEventsRequest request;
  request.set_request(std::string(bytes));
  request.set_signature(signature_of(request.request()));
  return request.SerializeAsString();
}

std::string seek() { return *fabric::make_seek(user(), "teleop", 0, realtime_ns(), std::string(24, 'n')); }
std::string seek_payload() {
  common::Envelope envelope;
  envelope.ParseFromString(seek());
  return envelope.payload();
}
std::string sign_seek(std::string_view payload) {
  common::Envelope envelope;
  envelope.set_payload(std::string(payload));
  envelope.set_signature(signature_of(envelope.payload()));
  return envelope.SerializeAsString();
}

/// Bytes at the TLS port itself. There is no answer in the protocol's words; the probe is a call beside it.
class Port final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    // The begin of a TLS 1.2 record with a client hello, of HTTP/2 without TLS, and of HTTP/1.
    return {{"\x16\x03\x01\x00\x2f\x01\x00\x00\x2b\x03\x03\x01\x02\x03\x04\x05\x06\x07\x08", 19},
            "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"};
  }
  std::vector<std::string> probes() override { return {probe_}; }
  Outcome feed(std::string_view bytes) override {
    if (bytes == probe_) {
      const Answer answer = call(blocks_service + "Deliver", seek(), milliseconds(20'000));
      return answer.answered ? accepted() : refused("a normal call: " + answer.status.error_message());
    }
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const std::string& endpoint = served().endpoint();
    sockaddr_in place{};
    place.sin_family = AF_INET;
    place.sin_port = htons(static_cast<std::uint16_t>(std::stoi(endpoint.substr(endpoint.rfind(':') + 1))));
    place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const bool connected = ::connect(fd, reinterpret_cast<const sockaddr*>(&place), sizeof place) == 0;
    if (connected) (void)!::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    // Gone without TIME_WAIT, of which ten thousand would be too many.
    const linger at_once{1, 0};
    ::setsockopt(fd, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    ::close(fd);
    return connected ? dropped() : refused("");
  }

 private:
  const std::string probe_ = "a normal call";
};

std::function<std::unique_ptr<Entry>()> raw(const std::string& method, std::string (*seed)(), Refusal refusal) {
  return [=] { return std::make_unique<Method>(method, std::vector{seed()}, refusal); };
}
std::function<std::unique_ptr<Entry>()> wrapped(const std::string& method, std::string (*seed)(), Refusal refusal,
                                                std::string (*wrap)(std::string_view)) {
  return [=] { return std::make_unique<Method>(method, std::vector{seed()}, refusal, wrap); };
}

std::string status_signed() { return sign_status(status_request()); }
std::string events_signed() { return sign_events(events_request()); }

using Peer = protos::DeliverResponse;
using Orderer = orderer::DeliverResponse;
const Registration registrations[] = {
    Registration({"grpc.Endorse", Kind::protobuf, raw(gateway_service + "Endorse", endorse_request, no_refusal)}),
    Registration({"grpc.Evaluate", Kind::protobuf, raw(gateway_service + "Evaluate", evaluate_request, no_refusal)}),
    Registration({"grpc.Submit", Kind::protobuf, raw(gateway_service + "Submit", submit_request, no_refusal)}),
    Registration(
        {"grpc.CommitStatus", Kind::protobuf, raw(gateway_service + "CommitStatus", status_signed, no_refusal)}),
    Registration({"grpc.CommitStatus_signed", Kind::protobuf,
                  wrapped(gateway_service + "CommitStatus", status_request, no_refusal, sign_status)}),
    Registration(
        {"grpc.ChaincodeEvents", Kind::protobuf, raw(gateway_service + "ChaincodeEvents", events_signed, no_refusal)}),
    Registration({"grpc.ChaincodeEvents_signed", Kind::protobuf,
                  wrapped(gateway_service + "ChaincodeEvents", events_request, no_refusal, sign_events)}),
    Registration({"grpc.ProcessProposal", Kind::protobuf,
                  raw("/protos.Endorser/ProcessProposal", signed_proposal, proposal_refusal)}),
    Registration({"grpc.Deliver", Kind::protobuf, raw(blocks_service + "Deliver", seek, status_refusal<Peer>)}),
    Registration({"grpc.Deliver_signed", Kind::protobuf,
                  wrapped(blocks_service + "Deliver", seek_payload, status_refusal<Peer>, sign_seek)}),
    Registration(
        {"grpc.DeliverFiltered", Kind::protobuf, raw(blocks_service + "DeliverFiltered", seek, status_refusal<Peer>)}),
    Registration({"grpc.DeliverWithPrivateData", Kind::protobuf,
                  raw(blocks_service + "DeliverWithPrivateData", seek, status_refusal<Peer>)}),
    Registration({"grpc.Broadcast", Kind::protobuf, raw(ordering_service + "Broadcast", envelope, broadcast_refusal)}),
    Registration(
        {"grpc.OrdererDeliver", Kind::protobuf, raw(ordering_service + "Deliver", seek, status_refusal<Orderer>)}),
    Registration({"grpc.port", Kind::bytes, [] { return std::make_unique<Port>(); }, 0.2, 0}),
};

}  // namespace
}  // namespace ledgerline::fuzz::grpc_part
