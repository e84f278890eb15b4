#include "common/common.pb.h"
#include "common/fabric/client/client.hpp"
#include "common/fabric/client/connection.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "common/ledger.pb.h"

namespace ledgerline::fabric {

Result<std::unique_ptr<PeerQueries>> PeerQueries::create(ClientConfig config) {
  auto connection = make_connection(std::move(config));
  if (!connection) return connection.error();
  return std::unique_ptr<PeerQueries>(new PeerQueries(std::move(*connection)));
}

Result<std::string> PeerQueries::propose(std::string_view signed_proposal) {
  const auto answer = query_peer(connection_->config.endpoint, connection_->channels()->peers.front(), signed_proposal,
                                 connection_->config.deadline);
  if (!answer) return answer.error();
  return answer->SerializeAsString();
}

Result<std::string> PeerQueries::query(const ChannelAndContract& where, const Call& call) {
  const auto proposal = make_proposal(*connection_->signing(), where, call, realtime_ns(), crypto::random_bytes(24));
  if (!proposal) return proposal.error();
  const auto answer = propose(proposal->signed_proposal);
  if (!answer) return answer.error();
  protos::ProposalResponse response;
  response.ParseFromString(*answer);
  if (response.response().status() != 200) return Error{words_of_peer(response.response().message())};
  return std::move(*response.mutable_response()->mutable_payload());
}

Result<std::uint64_t> PeerQueries::height() {
  const std::string& channel = connection_->config.where.channel;
  const auto answer = query({channel, "qscc"}, {"GetChainInfo", {channel}});
  if (!answer) return answer.error();
  common::BlockchainInfo info;
  if (!info.ParseFromString(*answer)) return Error{"the peer's answer is no BlockchainInfo"};
  return info.height();
}

Result<std::string> PeerQueries::block(std::uint64_t number) {
  const std::string& channel = connection_->config.where.channel;
  return query({channel, "qscc"}, {"GetBlockByNumber", {channel, std::to_string(number)}});
}

Result<std::string> PeerQueries::config_block() {
  const std::string& channel = connection_->config.where.channel;
  return query({channel, "cscc"}, {"GetConfigBlock", {channel}});
}

Result<ChannelConfig> PeerQueries::channel_config() {
  const auto bytes = config_block();
  if (!bytes) return bytes.error();
  common::Block block;
  if (!block.ParseFromString(*bytes)) return Error{"the peer's answer is no config block"};
  return read_channel_config(block);
}

}  // namespace ledgerline::fabric
