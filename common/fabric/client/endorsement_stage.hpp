#pragma once
#include <grpcpp/alarm.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/fabric/client/connection.hpp"
#include "common/fabric/client/endorsement_collector.hpp"
#include "gateway/gateway.grpc.pb.h"
#include "peer/peer.grpc.pb.h"

namespace ledgerline::fabric {

/// What comes out of a Pipeline's completion queue; who takes it out calls and deletes it.
using QueueTag = std::function<void(bool ok)>;

/// A unary call on a completion queue.
template <typename Response>
struct UnaryCall {
  explicit UnaryCall(std::chrono::system_clock::time_point deadline) { context.set_deadline(deadline); }

  grpc::ClientContext context;
  Response response;
  grpc::Status status;
  std::unique_ptr<grpc::ClientAsyncResponseReader<Response>> reader;
};
/// `then` comes on the queue's thread. The tag keeps the call until gRPC is done with it, also one that was cancelled.
template <typename Response>
void await(const std::shared_ptr<UnaryCall<Response>>& call, std::function<void()> then) {
  call->reader->Finish(&call->response, &call->status, new QueueTag([call, then = std::move(then)](bool) { then(); }));
}

/// One call on its way to an endorsed transaction.
struct EndorsementRequest {
  std::chrono::system_clock::time_point deadline;
  Proposal proposal;
  EndorsementNeed need;
  bool endorsing = true;  ///< false: it is endorsed, or nobody waits for it any more
  Attempts attempts;      ///< of the question that may be repeated now
  std::shared_ptr<grpc::Alarm> alarm;
  std::string unheard{};  ///< Outcome::unheard
  std::shared_ptr<UnaryCall<gateway::EndorseResponse>> endorse;
  std::shared_ptr<UnaryCall<protos::ProposalResponse>> propose;  ///< on the direct path in place of endorse
  std::optional<std::size_t> endorser{};  ///< the peer of `propose`, as EndorsementStage counts them; none: the own one
  std::vector<std::shared_ptr<UnaryCall<protos::ProposalResponse>>> proposals{};  ///< to several organisations
  std::optional<EndorsementCollector> collector{};                                ///< of their answers
};

/// A Pipeline's first stage: who endorses a call. The gateway; with orderers in the config a peer itself, or, where two
/// organisations are needed, their endorsers' peers side by side; of an organisation whose peers the config does not
/// name the gateway finds one. Nothing is ordered yet, so asking again is safe. On the pipeline's thread and queue.
class EndorsementStage {
 public:
  using RequestPtr = std::shared_ptr<EndorsementRequest>;
  struct Handlers {
    std::function<void(const RequestPtr&, const Result<std::string>& unsigned_envelope)> on_endorsed;
    std::function<void(const RequestPtr&, Outcome::Kind, const std::string& why)> on_failed;
  };
  EndorsementStage(std::shared_ptr<const Connection> connection, grpc::CompletionQueue& queue, Handlers handlers);

  /// Uses the connections that exist now; calls in flight end over the old ones. Null: they are the same as before.
  const GrpcChannels* renew_channels();
  /// Of the peer to ask now.
  gateway::Gateway::Stub& gateway() const { return *gateways_[connection_->peer()]; }

  void endorse(const RequestPtr& request);
  /// Nobody waits for it any more. `invalidated`: what it was endorsed with did not hold; its endorser may be behind.
  void end(EndorsementRequest& request, bool invalidated);
  /// Calls `again` after a pause, if that may help. False: it may not.
  bool retry(const RequestPtr& request, const grpc::Status& status, std::function<void()> again);

 private:
  using Time = std::chrono::system_clock::time_point;
  static constexpr std::chrono::milliseconds rest{200};

  void propose_to(const RequestPtr& request, protos::Endorser::Stub& endorser);
  /// Asks the endorser in this process. False: there is none, or it rests.
  bool propose_within(const RequestPtr& request);
  /// The same where several organisations are asked: whether it has answered.
  bool collect_within(EndorsementRequest& request, const std::string& organisation);
  /// False: the config does not name enough endorsers.
  bool collect(const RequestPtr& request);
  void on_collected(const RequestPtr& request, bool late);
  void on_gateway_answer(const RequestPtr& request);
  void on_proposal_answer(const RequestPtr& request);
  void on_not_endorsed(const RequestPtr& request, const grpc::Status& status);
  void on_endorsed(const RequestPtr& request, const Result<std::string>& unsigned_envelope);
  bool rests(std::size_t endorser) const { return std::chrono::system_clock::now() < rest_until_[endorser]; }
  /// Of its organisation another endorser, or the peer, is asked for a while: it does not answer, or is behind.
  void start_rest(std::size_t endorser, std::chrono::milliseconds time = rest);
  /// Whether the config names one more of its organisation behind it.
  bool has_another(std::size_t endorser) const;
  std::vector<std::size_t> endorsers_now() const;

  const std::shared_ptr<const Connection> connection_;
  grpc::CompletionQueue& queue_;
  const Handlers handlers_;
  Random random_{random_seed()};
  std::shared_ptr<const GrpcChannels> channels_;                    ///< that those below are of
  std::vector<std::unique_ptr<gateway::Gateway::Stub>> gateways_;   ///< of each peer
  std::vector<std::unique_ptr<protos::Endorser::Stub>> peers_;      ///< likewise
  std::vector<std::unique_ptr<protos::Endorser::Stub>> endorsers_;  ///< of each endorser
  const std::size_t within_;                                        ///< index of the endorser in this process: the last
  std::vector<Time> rest_until_;                                    ///< of each endorser, and of that one
};

}  // namespace ledgerline::fabric
