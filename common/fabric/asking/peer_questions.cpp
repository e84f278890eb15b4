#include "common/fabric/asking/peer_questions.hpp"

#include "common/fabric/client/connection.hpp"
#include "common/ledger.pb.h"

namespace ledgerline::fabric {

struct PeerQuestions::State {
  std::shared_ptr<const Connection> connection;
};

Result<std::unique_ptr<PeerQuestions>> PeerQuestions::create(ClientConfig config) {
  auto connection = make_connection(std::move(config));
  if (!connection) return connection.error();
  return std::unique_ptr<PeerQuestions>(new PeerQuestions(std::make_unique<State>(State{std::move(*connection)})));
}

PeerQuestions::PeerQuestions(std::unique_ptr<State> state) : state_(std::move(state)) {}
PeerQuestions::~PeerQuestions() = default;

Result<std::string> PeerQuestions::propose(std::string_view signed_proposal) {
  const Connection& connection = *state_->connection;
  const auto answer = ask_peer(connection.peers.front(), signed_proposal, connection.config.deadline);
  if (!answer) return answer.error();
  return answer->SerializeAsString();
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
