#include "common/fabric/client/client.hpp"

#include <fmt/format.h>

#include <future>

#include "common/fabric/client/connection.hpp"
#include "common/fabric/client/pipeline.hpp"
#include "common/fabric/client/stream_thread.hpp"

namespace ledgerline::fabric {
namespace {

class GatewayClient final : public Client {
 public:
  explicit GatewayClient(std::shared_ptr<const Connection> connection)
      : connection_(std::move(connection)), pipeline_(connection_) {}

  void submit(Call call, std::function<void(Outcome)> done) override {
    pipeline_.submit(std::move(call), std::move(done));
  }

  Outcome submit_and_wait(Call call) override {
    std::promise<Outcome> promise;
    pipeline_.submit(std::move(call), [&promise](Outcome outcome) { promise.set_value(std::move(outcome)); });
    return promise.get_future().get();
  }

  Result<std::string> evaluate(Call call) override {
    gateway::EvaluateResponse response;
    const Status answered = query<gateway::EvaluateRequest>(
        call, [&](gateway::Gateway::Stub& stub, grpc::ClientContext& context, const gateway::EvaluateRequest& request) {
          return stub.Evaluate(&context, request, &response);
        });
    if (!answered) return answered.error();
    return std::move(*response.mutable_result()->mutable_payload());
  }

  Result<std::string> evaluate_at_peer(Call call) override {
    protos::ProposalResponse response;
    const Status answered = query_repeatedly(call, [&](const Proposal& proposal, grpc::ClientContext& context) {
      protos::SignedProposal request;
      request.ParseFromString(proposal.signed_proposal);
      return protos::Endorser::NewStub(connection_->channels()->peers[0])
          ->ProcessProposal(&context, request, &response);
    });
    if (!answered) return answered.error();
    if (response.response().status() >= 400) return Error{words_of_peer(response.response().message())};
    return std::move(*response.mutable_response()->mutable_payload());
  }

  Status endorsable(Call call) override {
    gateway::EndorseResponse response;
    return query<gateway::EndorseRequest>(
        call, [&](gateway::Gateway::Stub& stub, grpc::ClientContext& context, gateway::EndorseRequest& request) {
          if (call.need && !call.need->organisation.empty())
            request.add_endorsing_organizations(call.need->organisation);
          return stub.Endorse(&context, request, &response);
        });
  }

  std::unique_ptr<Stream> blocks(std::optional<std::uint64_t> start, StreamHandlers handlers) override {
    return open_block_stream(connection_, start, std::nullopt, shared(std::move(handlers)));
  }

  std::unique_ptr<Stream> blocks_behind(LastVerified verified, StreamHandlers handlers) override {
    return open_block_stream(connection_, std::nullopt, std::move(verified), shared(std::move(handlers)));
  }

  std::unique_ptr<Stream> events(std::optional<std::uint64_t> start, std::function<void(const Event&)> on_event,
                                 std::function<void(bool, const std::string&)> on_connection,
                                 std::string after_tx_id) override {
    return open_event_stream(connection_, start, std::move(after_tx_id), std::move(on_event), std::move(on_connection));
  }

 private:
  StreamHandlers shared(StreamHandlers handlers) const {
    const auto& endorser = connection_->config.own_endorser;
    return endorser ? endorser->fed_by(std::move(handlers)) : std::move(handlers);
  }

  /// A question to the gateway until it answers, within the deadline.
  template <typename Request, typename Rpc>
  Status query(const Call& call, const Rpc& rpc) {
    return query_repeatedly(call, [&](const Proposal& proposal, grpc::ClientContext& context) {
      Request request;
      request.set_transaction_id(proposal.tx_id);
      request.set_channel_id(connection_->config.where.channel);
      request.mutable_proposed_transaction()->ParseFromString(proposal.signed_proposal);
      const auto stub = gateway::Gateway::NewStub(connection_->channels()->peers[connection_->peer()]);
      return rpc(*stub, context, request);
    });
  }

  template <typename Rpc>
  Status query_repeatedly(const Call& call, const Rpc& rpc) {
    const auto deadline = std::chrono::system_clock::now() + connection_->config.deadline;
    Attempts attempts;
    Random random(random_seed());
    while (true) {
      auto proposal = make_proposal(*connection_->signing(), connection_->config.where, call, realtime_ns(),
                                    crypto::random_bytes(24));
      if (!proposal) return proposal.error();
      grpc::ClientContext context;
      context.set_deadline(deadline);
      const grpc::Status status = rpc(*proposal, context);
      if (status.ok()) return done;
      const auto next = attempts.next(status, deadline, random);
      if (!next)
        return Error{is_away(status) ? fmt::format("ledger at {}: {}", connection_->config.endpoint, describe(status))
                                     : describe(status)};
      std::this_thread::sleep_until(*next);
    }
  }

  const std::shared_ptr<const Connection> connection_;
  Pipeline pipeline_;
};

}  // namespace

Result<std::unique_ptr<Client>> Client::create(ClientConfig config) {
  auto connection = make_connection(std::move(config));
  if (!connection) return connection.error();
  return std::unique_ptr<Client>(std::make_unique<GatewayClient>(std::move(*connection)));
}

}  // namespace ledgerline::fabric
