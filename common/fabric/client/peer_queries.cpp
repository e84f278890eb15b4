#include "common/fabric/client/peer_queries.hpp"

#include "common/common.pb.h"
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
  const auto answer = ask_peer(connection.channels()->peers.front(), signed_proposal, connection.config.deadline);
  if (!answer) return answer.error();
  return answer->SerializeAsString();
}

Result<std::string> PeerQuestions::ask(const ChannelAndContract& where, const Call& call) {
  const auto proposal =
      make_proposal(*state_->connection->signing(), where, call, realtime_ns(), crypto::random_bytes(24));
  if (!proposal) return proposal.error();
  const auto answer = propose(proposal->signed_proposal);
  if (!answer) return answer.error();
  protos::ProposalResponse response;
  response.ParseFromString(*answer);
  if (response.response().status() != 200) return Error{words_of_peer(response.response().message())};
  return std::move(*response.mutable_response()->mutable_payload());
}

Result<std::uint64_t> PeerQuestions::height() {
  const std::string& channel = state_->connection->config.where.channel;
  const auto answer = ask({channel, "qscc"}, {"GetChainInfo", {channel}});
  if (!answer) return answer.error();
  common::BlockchainInfo info;
  if (!info.ParseFromString(*answer)) return Error{"the peer's answer is no BlockchainInfo"};
  return info.height();
}

Result<std::string> PeerQuestions::block(std::uint64_t number) {
  const std::string& channel = state_->connection->config.where.channel;
  return ask({channel, "qscc"}, {"GetBlockByNumber", {channel, std::to_string(number)}});
}

Result<std::string> PeerQuestions::config_block() {
  const std::string& channel = state_->connection->config.where.channel;
  return ask({channel, "cscc"}, {"GetConfigBlock", {channel}});
}

Result<ChannelConfig> PeerQuestions::channel_config() {
  const auto bytes = config_block();
  if (!bytes) return bytes.error();
  common::Block block;
  if (!block.ParseFromString(*bytes)) return Error{"the peer's answer is no config block"};
  return read_channel_config(block);
}

}  // namespace ledgerline::fabric
