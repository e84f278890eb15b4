#include <fmt/format.h>

#include <algorithm>

#include "common/fabric/client/stream_thread.hpp"
#include "gateway/gateway.grpc.pb.h"

namespace ledgerline::fabric {
namespace {

class EventReader {
 public:
  EventReader(std::shared_ptr<const Connection> connection, std::optional<std::uint64_t> start, std::string after_tx_id,
              std::function<void(const Client::Event&)> on_event)
      : connection_(std::move(connection)), block_(start), on_event_(std::move(on_event)) {
    if (!after_tx_id.empty()) handed_over_.push_back(std::move(after_tx_id));
  }

  std::string follow(StreamThread& thread) {
    if (!block_) {
      // Known before the first event, so that what comes during a lost connection is not lost as well.
      const auto newest = fetch_block(*connection_, thread, std::nullopt);
      if (!newest) return newest.error().message;
      block_ = newest->header().number() + 1;
    }
    const auto request = make_request();
    if (!request) return request.error().message;
    grpc::ClientContext context;
    const StreamThread::Cancellable cancellable(thread, context);
    const std::size_t which = connection_->peer();
    const std::shared_ptr<grpc::Channel> peer = connection_->channels()->stream_peers[which];
    const auto stub = gateway::Gateway::NewStub(peer);
    const auto stream = stub->ChaincodeEvents(&context, *request);
    // The first answer may be far off; the question is out when the channel stands.
    if (peer->GetState(false) == GRPC_CHANNEL_READY) thread.connected();
    gateway::ChaincodeEventsResponse response;
    return read_all(thread, context, *stream, connection_->endpoint(which), response,
                    [&](gateway::ChaincodeEventsResponse& events) {
                      thread.connected();
                      Status handed_over = hand_over(events, thread);
                      if (handed_over) thread.progress();
                      return handed_over;
                    });
  }

 private:
  Result<gateway::SignedChaincodeEventsRequest> make_request() const {
    gateway::SignedChaincodeEventsRequest request;
    const auto self = connection_->signing();
    gateway::ChaincodeEventsRequest question;
    question.set_channel_id(connection_->config.where.channel);
    question.set_chaincode_id(connection_->config.where.contract);
    question.set_identity(self->serialized);
    question.mutable_start_position()->mutable_specified()->set_number(*block_);
    if (!handed_over_.empty()) question.set_after_transaction_id(handed_over_.back());
    request.set_request(question.SerializeAsString());
    auto signature = self->signer->sign(request.request());
    if (!signature) return signature.error();
    request.set_signature(std::move(*signature));
    return request;
  }

  Status hand_over(gateway::ChaincodeEventsResponse& response, StreamThread& thread) {
    if (response.block_number() < *block_)
      return Error{fmt::format("events of block {} came where {} was due", response.block_number(), *block_)};
    for (protos::ChaincodeEvent& event : *response.mutable_events()) {
      if (thread.stopping()) break;
      if (response.block_number() != *block_) handed_over_.clear();
      block_ = response.block_number();
      // A transaction has one event; after a reconnect the peer may send the block's first ones again.
      if (std::find(handed_over_.begin(), handed_over_.end(), event.tx_id()) != handed_over_.end()) continue;
      handed_over_.push_back(event.tx_id());
      on_event_({*block_, event.tx_id(), std::move(*event.mutable_event_name()), std::move(*event.mutable_payload())});
    }
    return done;
  }

  const std::shared_ptr<const Connection> connection_;
  std::optional<std::uint64_t> block_;    ///< of the last event handed over, or where to start
  std::vector<std::string> handed_over_;  ///< transactions of that block
  const std::function<void(const Client::Event&)> on_event_;
};

}  // namespace

std::unique_ptr<Client::Stream> open_event_stream(std::shared_ptr<const Connection> connection,
                                                  std::optional<std::uint64_t> start, std::string after_tx_id,
                                                  std::function<void(const Client::Event&)> on_event,
                                                  StreamThread::OnConnection on_connection) {
  auto reader =
      std::make_shared<EventReader>(std::move(connection), start, std::move(after_tx_id), std::move(on_event));
  return run_reader(std::move(reader), std::move(on_connection));
}

}  // namespace ledgerline::fabric
