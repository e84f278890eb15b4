#include "tests/unit/common/fabric/client/fake_gateway.hpp"

#include <fmt/format.h>
#include <google/protobuf/any.pb.h>
#include <google/protobuf/empty.pb.h>
#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <stdexcept>

#include "gateway/gateway.grpc.pb.h"
#include "orderer/ab.grpc.pb.h"
#include "peer/events.grpc.pb.h"
#include "peer/proposal.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {
namespace {

using std::chrono::milliseconds;

grpc::Status to_grpc(const FakeStatus& status) {
  if (status.code == 0) return grpc::Status::OK;
  const auto code = static_cast<grpc::StatusCode>(status.code);
  if (status.detail.empty()) return {code, status.message};
  gateway::ErrorDetail detail;
  detail.set_address("127.0.0.1:1");
  detail.set_msp_id("Org1MSP");
  detail.set_message(status.detail);
  google::protobuf::Any any;
  any.set_type_url("type.googleapis.com/gateway.ErrorDetail");
  any.set_value(detail.SerializeAsString());
  google::protobuf::Empty details;  // as google.rpc.Status: code 1, message 2, details 3
  auto* fields = details.GetReflection()->MutableUnknownFields(&details);
  fields->AddVarint(1, static_cast<std::uint64_t>(status.code));
  fields->AddLengthDelimited(2, status.message);
  fields->AddLengthDelimited(3, any.SerializeAsString());
  return {code, status.message, details.SerializeAsString()};
}

}  // namespace

struct FakeGateway::State {
  explicit State(Behaviour b) : behaviour(std::move(b)) {
    dir = std::filesystem::temp_directory_path() /
          fmt::format("fake-gateway-{}-{}", ::getpid(), crypto::hex(crypto::random_bytes(4)));
    std::filesystem::create_directories(dir);
    std::ofstream(dir / "tlsca.pem") << tls_ca.certificate_pem;
    write_msp("user", user);
    write_msp("peer", peer_pair);
    peer = crypto::load_identity(crypto::Library::libcrypto, "Org1MSP", (dir / "peer").string()).value();
    chain.push_back(make_config_block("teleop"));
  }
  ~State() { std::filesystem::remove_all(dir); }

  void write_msp(const std::string& name, const crypto::KeyAndCertificate& pair) const {
    std::filesystem::create_directories(dir / name / "signcerts");
    std::filesystem::create_directories(dir / name / "keystore");
    std::ofstream(dir / name / "signcerts" / "cert.pem") << pair.certificate_pem;
    const auto key = dir / name / "keystore" / "priv_sk";
    std::ofstream(key) << pair.key_pem;
    std::filesystem::permissions(key, std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  }

  bool signed_well(const std::string& creator, const std::string& message, const std::string& signature) {
    auto member = registry->member(creator, std::time(nullptr));
    return member && (*member)->verifier->verify(message, signature);
  }

  void order(const std::vector<std::string>& envelopes, const std::vector<Call>& called) {
    std::string flags;
    for (const Call& call : called) flags.push_back(behaviour.flag ? behaviour.flag(call) : '\0');
    const std::lock_guard lock(mutex);
    chain.push_back(make_block(&chain.back(), envelopes, flags));
    const Block block = decode_block(chain.back().SerializeAsString()).value();
    for (const Transaction& t : block.transactions) committed.emplace(t.tx_id, std::pair(block.number, t.code));
    changed.notify_all();
  }

  /// Waits until block `number` is there; false when the caller has gone or the server stops.
  template <typename Context>
  bool await_block(std::uint64_t number, Context& context, common::Block& out) {
    std::unique_lock lock(mutex);
    while (chain.size() <= number) {
      if (context.IsCancelled() || stopping) return false;
      changed.wait_for(lock, milliseconds(2));
    }
    out = chain[number];
    return !stopping;
  }

  Behaviour behaviour;
  std::filesystem::path dir;
  const crypto::KeyAndCertificate tls_ca = crypto::make_ca("tlsca.org1", "org1").value();
  const crypto::KeyAndCertificate ca = crypto::make_ca("ca.org1", "org1").value();
  const crypto::KeyAndCertificate user =
      crypto::issue(ca, {.common_name = "User1@org1", .organization = "", .unit = "client", .sans = {}}).value();
  const crypto::KeyAndCertificate peer_pair =
      crypto::issue(ca, {.common_name = "peer0.org1", .organization = "", .unit = "peer", .sans = {}}).value();
  const crypto::KeyAndCertificate tls =
      crypto::issue(
          tls_ca,
          {.common_name = "peer0.org1", .organization = "", .unit = std::nullopt, .sans = {"127.0.0.1"}, .tls = true})
          .value();
  const std::unique_ptr<crypto::MspRegistry> registry =
      crypto::make_msp_registry(crypto::Library::libcrypto, {{"Org1MSP", ca.certificate_pem}});
  crypto::SigningIdentity peer;

  mutable std::mutex mutex;
  mutable std::condition_variable changed;
  std::vector<common::Block> chain;
  std::map<std::string, std::pair<std::uint64_t, int>> committed;
  std::map<std::string, Call> calls;        ///< by transaction
  std::map<std::string, int> endorsements;  ///< asked for, by transaction
  int endorse_calls = 0, submit_calls = 0, status_calls = 0, deliver_calls = 0, events_calls = 0;
  bool stopping = false;

  struct GatewayService;
  struct DeliverService;
  struct OrdererService;
  std::unique_ptr<gateway::Gateway::Service> gateway_service;
  std::unique_ptr<protos::Deliver::Service> deliver_service;
  std::unique_ptr<orderer::AtomicBroadcast::Service> orderer_service;
  std::unique_ptr<grpc::Server> server;
  int port = 0;
};

struct FakeGateway::State::GatewayService final : gateway::Gateway::Service {
  explicit GatewayService(State& s) : state(s) {}

  grpc::Status Endorse(grpc::ServerContext* context, const gateway::EndorseRequest* request,
                       gateway::EndorseResponse* response) override {
    const std::string bytes = request->proposed_transaction().SerializeAsString();
    const Call call = call_of(bytes);
    int attempt = 0;
    {
      const std::lock_guard lock(state.mutex);
      ++state.endorse_calls;
      attempt = ++state.endorsements[request->transaction_id()];
      state.calls[request->transaction_id()] = call;
      state.changed.notify_all();
    }
    protos::Proposal proposal;
    common::Header header;
    common::SignatureHeader signature;
    proposal.ParseFromString(request->proposed_transaction().proposal_bytes());
    header.ParseFromString(proposal.header());
    signature.ParseFromString(header.signature_header());
    if (!state.signed_well(signature.creator(), request->proposed_transaction().proposal_bytes(),
                           request->proposed_transaction().signature())) {
      return {grpc::StatusCode::ABORTED, "error validating proposal: access denied"};
    }
    if (state.behaviour.endorse) {
      const FakeStatus status = state.behaviour.endorse(call, attempt);
      if (status.code != 0) return to_grpc(status);
    }
    if (context->IsCancelled()) return grpc::Status::CANCELLED;
    common::Envelope envelope = endorse(bytes, {state.peer}, "answer to " + call.function, call.function,
                                        call.args.empty() ? "" : call.args[0]);
    if (state.behaviour.forge) state.behaviour.forge(envelope);
    *response->mutable_prepared_transaction() = envelope;
    return grpc::Status::OK;
  }

  grpc::Status Submit(grpc::ServerContext*, const gateway::SubmitRequest* request, gateway::SubmitResponse*) override {
    const std::string& tx_id = request->transaction_id();
    {
      const std::lock_guard lock(state.mutex);
      ++state.submit_calls;
    }
    if (state.behaviour.before_submit) {
      const FakeStatus status = state.behaviour.before_submit(tx_id);
      if (status.code != 0) return to_grpc(status);
    }
    const common::Envelope& envelope = request->prepared_transaction();
    const Block probe =
        decode_block(make_block(nullptr, {envelope.SerializeAsString()}, "").SerializeAsString()).value();
    if (!state.signed_well(probe.transactions[0].creator, envelope.payload(), envelope.signature())) {
      return {grpc::StatusCode::ABORTED, "status=FORBIDDEN"};
    }
    Call call;
    {
      const std::lock_guard lock(state.mutex);
      call = state.calls[tx_id];
    }
    state.order({envelope.SerializeAsString()}, {call});
    return state.behaviour.after_submit ? to_grpc(state.behaviour.after_submit(tx_id)) : grpc::Status::OK;
  }

  grpc::Status CommitStatus(grpc::ServerContext* context, const gateway::SignedCommitStatusRequest* request,
                            gateway::CommitStatusResponse* response) override {
    gateway::CommitStatusRequest question;
    question.ParseFromString(request->request());
    {
      const std::lock_guard lock(state.mutex);
      ++state.status_calls;
      state.changed.notify_all();
    }
    if (!state.signed_well(question.identity(), request->request(), request->signature())) {
      return {grpc::StatusCode::PERMISSION_DENIED, "access denied"};
    }
    if (state.behaviour.status) {
      const FakeStatus status = state.behaviour.status(question.transaction_id());
      if (status.code != 0) return to_grpc(status);
    }
    std::unique_lock lock(state.mutex);
    while (!state.committed.contains(question.transaction_id())) {
      if (context->IsCancelled() || state.stopping) return grpc::Status::CANCELLED;
      state.changed.wait_for(lock, milliseconds(2));
    }
    const auto [block, code] = state.committed[question.transaction_id()];
    response->set_block_number(block);
    response->set_result(static_cast<protos::TxValidationCode>(code));
    return grpc::Status::OK;
  }

  grpc::Status Evaluate(grpc::ServerContext*, const gateway::EvaluateRequest* request,
                        gateway::EvaluateResponse* response) override {
    const Call call = call_of(request->proposed_transaction().SerializeAsString());
    int attempt = 0;
    {
      const std::lock_guard lock(state.mutex);
      attempt = ++state.endorse_calls;
    }
    if (state.behaviour.endorse) {
      const FakeStatus status = state.behaviour.endorse(call, attempt);
      if (status.code != 0) return to_grpc(status);
    }
    response->mutable_result()->set_status(200);
    response->mutable_result()->set_payload("answer to " + call.function);
    return grpc::Status::OK;
  }

  grpc::Status ChaincodeEvents(grpc::ServerContext* context, const gateway::SignedChaincodeEventsRequest* request,
                               grpc::ServerWriter<gateway::ChaincodeEventsResponse>* writer) override {
    gateway::ChaincodeEventsRequest question;
    question.ParseFromString(request->request());
    {
      const std::lock_guard lock(state.mutex);
      ++state.events_calls;
    }
    if (!state.signed_well(question.identity(), request->request(), request->signature())) {
      return {grpc::StatusCode::PERMISSION_DENIED, "access denied"};
    }
    const std::uint64_t first = question.start_position().specified().number();
    bool skipping = !question.after_transaction_id().empty();
    for (std::uint64_t number = first;; ++number) {
      common::Block block;
      if (!state.await_block(number, *context, block)) return {grpc::StatusCode::UNAVAILABLE, "the peer is going down"};
      const Block decoded = decode_block(block.SerializeAsString()).value();
      if (number > first) skipping = false;
      // One response per event, so that a stream can be cut within a block.
      for (std::size_t i = 0; i < decoded.transactions.size(); ++i) {
        const Transaction& t = decoded.transactions[i];
        if (skipping) {
          skipping = t.tx_id != question.after_transaction_id();
          continue;
        }
        if (t.code != 0 || t.event_name.empty()) continue;
        gateway::ChaincodeEventsResponse response;
        response.set_block_number(number);
        protos::ChaincodeEvent& event = *response.add_events();
        event.set_chaincode_id(t.contract);
        event.set_tx_id(t.tx_id);
        event.set_event_name(t.event_name);
        event.set_payload(t.event_payload);
        if (!writer->Write(response)) return grpc::Status::CANCELLED;
        if (state.behaviour.cut && state.behaviour.cut(number, i)) return {grpc::StatusCode::UNAVAILABLE, "cut"};
      }
    }
  }

  State& state;
};

namespace {

template <typename State, typename Response>
grpc::Status serve_blocks(State& state, grpc::ServerContext* context,
                          grpc::ServerReaderWriter<Response, common::Envelope>* stream,
                          const std::function<std::optional<common::Block>(const common::Block&)>& bent) {
  common::Envelope envelope;
  if (!stream->Read(&envelope)) return grpc::Status::CANCELLED;
  common::Payload payload;
  common::SignatureHeader signature;
  orderer::SeekInfo seek;
  payload.ParseFromString(envelope.payload());
  signature.ParseFromString(payload.header().signature_header());
  seek.ParseFromString(payload.data());
  Response response;
  std::uint64_t number = 0;
  {
    const std::lock_guard lock(state.mutex);
    ++state.deliver_calls;
    number = seek.start().has_newest() ? state.chain.size() - 1 : seek.start().specified().number();
  }
  if (state.behaviour.refuse_deliver ||
      !state.signed_well(signature.creator(), envelope.payload(), envelope.signature())) {
    response.set_status(static_cast<common::Status>(state.behaviour.refuse_deliver.value_or(common::FORBIDDEN)));
    stream->Write(response);
    return grpc::Status::OK;
  }
  for (;; ++number) {
    common::Block block;
    if (!state.await_block(number, *context, block)) return {grpc::StatusCode::UNAVAILABLE, "the peer is going down"};
    if (bent) {
      if (auto other = bent(block)) block = std::move(*other);
    }
    *response.mutable_block() = block;
    if (!stream->Write(response)) return grpc::Status::CANCELLED;
    if (state.behaviour.cut && state.behaviour.cut(number, 0)) return {grpc::StatusCode::UNAVAILABLE, "cut"};
  }
}

}  // namespace

struct FakeGateway::State::DeliverService final : protos::Deliver::Service {
  explicit DeliverService(State& s) : state(s) {}
  grpc::Status Deliver(grpc::ServerContext* context,
                       grpc::ServerReaderWriter<protos::DeliverResponse, common::Envelope>* stream) override {
    return serve_blocks(state, context, stream, state.behaviour.deliver);
  }
  State& state;
};

struct FakeGateway::State::OrdererService final : orderer::AtomicBroadcast::Service {
  explicit OrdererService(State& s) : state(s) {}
  grpc::Status Deliver(grpc::ServerContext* context,
                       grpc::ServerReaderWriter<orderer::DeliverResponse, common::Envelope>* stream) override {
    return serve_blocks(state, context, stream, state.behaviour.ordered);
  }
  State& state;
};

FakeGateway::FakeGateway(Behaviour behaviour) : state_(std::make_shared<State>(std::move(behaviour))) { start(); }
FakeGateway::~FakeGateway() { stop(); }

void FakeGateway::start() {
  state_->stopping = false;
  state_->gateway_service = std::make_unique<State::GatewayService>(*state_);
  state_->deliver_service = std::make_unique<State::DeliverService>(*state_);
  state_->orderer_service = std::make_unique<State::OrdererService>(*state_);
  grpc::SslServerCredentialsOptions options;
  options.pem_key_cert_pairs.push_back({state_->tls.key_pem, state_->tls.certificate_pem});
  grpc::ServerBuilder builder;
  builder.AddListeningPort(fmt::format("127.0.0.1:{}", state_->port), grpc::SslServerCredentials(options),
                           &state_->port);
  builder.RegisterService(state_->gateway_service.get());
  builder.RegisterService(state_->deliver_service.get());
  builder.RegisterService(state_->orderer_service.get());
  state_->server = builder.BuildAndStart();
  if (!state_->server) throw std::runtime_error("the fake gateway cannot listen");
}

void FakeGateway::stop() {
  if (!state_->server) return;
  {
    const std::lock_guard lock(state_->mutex);
    state_->stopping = true;
    state_->changed.notify_all();
  }
  state_->server->Shutdown(std::chrono::system_clock::now());
  state_->server.reset();
}

ClientConfig FakeGateway::client_config(crypto::Library signer) const {
  ClientConfig config;
  config.endpoint = fmt::format("127.0.0.1:{}", state_->port);
  config.tls_ca_file = (state_->dir / "tlsca.pem").string();
  config.identity = crypto::load_identity(signer, "Org1MSP", (state_->dir / "user").string()).value();
  return config;
}

crypto::SigningIdentity FakeGateway::renewed_identity() const {
  state_->write_msp(
      "renewed",
      crypto::issue(state_->ca, {.common_name = "User1@org1", .organization = "", .unit = "client", .sans = {}})
          .value());
  return crypto::load_identity(crypto::Library::libcrypto, "Org1MSP", (state_->dir / "renewed").string()).value();
}

void FakeGateway::add_block(const std::string& function, const std::string& event) { add_block({{function, {event}}}); }

void FakeGateway::add_block(const std::vector<Call>& calls) {
  std::vector<std::string> envelopes;
  for (const Call& call : calls)
    envelopes.push_back(make_transaction(state_->peer, state_->peer, call, crypto::random_bytes(24)));
  state_->order(envelopes, calls);
}

std::vector<Block> FakeGateway::chain() const {
  const std::lock_guard lock(state_->mutex);
  std::vector<Block> out;
  for (const common::Block& block : state_->chain) out.push_back(decode_block(block.SerializeAsString()).value());
  return out;
}

void FakeGateway::add_foreign_event() {
  const Call call{"set", {"event"}};
  const std::string honest = make_transaction(state_->peer, state_->peer, call, crypto::random_bytes(24));
  state_->order({with_foreign_event(honest)}, {call});
}

int FakeGateway::endorse_calls() const {
  const std::lock_guard lock(state_->mutex);
  return state_->endorse_calls;
}
int FakeGateway::submit_calls() const {
  const std::lock_guard lock(state_->mutex);
  return state_->submit_calls;
}
int FakeGateway::deliver_calls() const {
  const std::lock_guard lock(state_->mutex);
  return state_->deliver_calls;
}
int FakeGateway::events_calls() const {
  const std::lock_guard lock(state_->mutex);
  return state_->events_calls;
}
void FakeGateway::await_endorse_calls(int count) const {
  std::unique_lock lock(state_->mutex);
  state_->changed.wait(lock, [&] { return state_->endorse_calls >= count; });
}
void FakeGateway::await_status_calls(int count) const {
  std::unique_lock lock(state_->mutex);
  state_->changed.wait(lock, [&] { return state_->status_calls >= count; });
}

}  // namespace ledgerline::fabric
