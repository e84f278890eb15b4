#include <fmt/format.h>

#include "common/fabric/client/connection.hpp"
#include "common/fabric/receipt/receipt.hpp"

namespace ledgerline::fabric {
namespace {

struct Peer {
  std::string name;  ///< for messages
  std::shared_ptr<grpc::Channel> channel;
};

std::vector<Peer> peers_to_ask(const Connection& connection) {
  const ClientConfig& config = connection.config;
  const std::string& own = config.identity.name.msp_id;
  std::vector<Peer> peers;
  bool own_known = false;
  for (const std::size_t i : connection.endorsers_now()) {
    const ClientConfig::Endorser& endorser = config.endorsers[i];
    own_known = own_known || endorser.msp_id == own;
    peers.push_back({fmt::format("{} ({})", endorser.endpoint, endorser.msp_id), connection.channels()->endorsers[i]});
  }
  if (!own_known) peers.push_back({config.endpoint, connection.channels()->peers[connection.peer()]});
  return peers;
}

/// Its answer, or why there is none.
Result<PeerAnswer> ask(const Peer& peer, const std::string& question, std::chrono::milliseconds deadline) {
  const auto response = query_peer(peer.name, peer.channel, question, deadline);
  if (!response) return response.error();
  if (response->response().status() != 200) return Error{words_of_peer(response->response().message())};
  return PeerAnswer{peer.name, response->SerializeAsString()};
}

}  // namespace

Result<CollectedReceipt> collect_receipt(ClientConfig config, const std::string& tx_id) {
  config.where.contract = chain_contract;
  const std::string channel = config.where.channel;
  auto client = Client::create(config);
  if (!client) return client.error();
  const auto block = (*client)->evaluate({"GetBlockByTxID", {channel, tx_id}});
  if (!block) return Error{fmt::format("transaction {}: its block: {}", tx_id, block.error().message)};

  const auto connection = make_connection(std::move(config));
  if (!connection) return connection.error();
  const ClientConfig& settings = (*connection)->config;
  const auto proposal = make_proposal(settings.identity, settings.where, {verdict_function, {channel, tx_id}},
                                      realtime_ns(), crypto::random_bytes(24));
  if (!proposal) return proposal.error();
  std::vector<PeerAnswer> answers;
  CollectedReceipt out;
  for (const Peer& peer : peers_to_ask(**connection)) {
    auto answer = ask(peer, proposal->signed_proposal, settings.deadline);
    if (answer) {
      answers.push_back(std::move(*answer));
    } else {
      out.unheard.push_back(fmt::format("{}: {}", peer.name, answer.error().message));
    }
  }
  if (answers.empty())
    return Error{fmt::format("transaction {}: no peer has answered; {}", tx_id, fmt::join(out.unheard, "; "))};
  auto receipt = make_receipt(channel, tx_id, *block, proposal->signed_proposal, answers);
  if (!receipt) return Error{fmt::format("transaction {}: {}", tx_id, receipt.error().message)};
  out.receipt = std::move(*receipt);
  return out;
}

}  // namespace ledgerline::fabric
