#include "common/fabric/asking/peer_questions.hpp"

#include "common/fabric/client/connection.hpp"
#include "common/ledger.pb.h"
#include "peer/peer.grpc.pb.h"

namespace ledgerline::fabric {

struct PeerQuestions::State {
  std::shared_ptr<const Connection> connection;
  std::unique_ptr<protos::Endorser::Stub> peer;
};

Result<std::unique_ptr<PeerQuestions>> PeerQuestions::create(ClientConfig config) {
  auto connection = make_connection(std::move(config));
  if (!connection) return connection.error();
  auto peer = protos::Endorser::NewStub((*connection)->peers.front());
  return std::unique_ptr<PeerQuestions>(
      new PeerQuestions(std::make_unique<State>(State{std::move(*connection), std::move(peer)})));
}

PeerQuestions::PeerQuestions(std::unique_ptr<State> state) : state_(std::move(state)) {}
PeerQuestions::~PeerQuestions() = default;

Result<std::string> PeerQuestions::propose(std::string_view signed_proposal) {
  protos::SignedProposal question;
  if (!question.ParseFromArray(signed_proposal.data(), static_cast<int>(signed_proposal.size())))
    return Error{"what was to be asked is no proposal"};
  protos::ProposalResponse response;
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + state_->connection->config.deadline);
  const grpc::Status status = state_->peer->ProcessProposal(&context, question, &response);
  if (!status.ok()) return Error{describe(status)};
  return response.SerializeAsString();
}

Result<std::uint64_t> PeerQuestions::height() {
  const ClientConfig& config = state_->connection->config;
  const auto proposal =
      make_proposal(config.identity, {config.where.channel, "qscc"}, {"GetChainInfo", {config.where.channel}},
                    realtime_ns(), crypto::random_bytes(24));
  if (!proposal) return proposal.error();
  const auto answer = propose(proposal->signed_proposal);
  if (!answer) return answer.error();
  protos::ProposalResponse response;
  common::BlockchainInfo info;
  response.ParseFromString(*answer);
  if (response.response().status() != 200) return Error{response.response().message()};
  if (!info.ParseFromString(response.response().payload())) return Error{"the peer's answer is no BlockchainInfo"};
  return info.height();
}

}  // namespace ledgerline::fabric
