#include "tools/checks/shell/probes.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>

#include "common/fabric/client/client.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "common/msg/contract.hpp"
#include "msp/identities.pb.h"
#include "peer/proposal_response.pb.h"

namespace ledgerline::checks {
namespace {

/// What any member may write.
fabric::Call note_of(const std::string& msp_id) {
  return {contract::set, {nlohmann::json{{"id", msp_id + "/doctor"}, {"msgType", "none"}}.dump()}};
}

void read_answer(const std::string& answer, EndorsingPeer& peer) {
  protos::ProposalResponse response;
  msp::SerializedIdentity signer;
  if (!response.ParseFromString(answer)) {
    peer.why = "its answer cannot be read";
  } else if (response.response().status() >= 400) {
    peer.why = response.response().message();
  } else if (!signer.ParseFromString(response.endorsement().endorser())) {
    peer.why = "it answers, and does not sign";
  } else {
    peer.msp_id = signer.mspid();
    peer.identity = response.endorsement().endorser();
  }
}

class EndorserQueries {
 public:
  EndorserQueries(const ProgramConfig& one, const fabric::ClientConfig& client)
      : one_(one), client_(client), note_(note_of(client.identity.name.msp_id)) {}

  EndorsingPeer peer_at(const ServerKeys& server, const std::string& msp_id, const std::string& table) const {
    EndorsingPeer peer{.msp_id = msp_id, .place = fmt::format("{} {}", table, server.endpoint)};
    auto questions = fabric::PeerQueries::create(client_at(server, client_));
    const auto proposal =
        fabric::make_proposal(client_.identity, client_.where, note_, realtime_ns(), crypto::random_bytes(24));
    if (!questions || !proposal) {
      peer.why = questions ? proposal.error().message : questions.error().message;
    } else if (auto answer = (*questions)->propose(proposal->signed_proposal); !answer) {
      peer.why = answer.error().message;
    } else {
      read_answer(*answer, peer);
    }
    return peer;
  }

  /// Those that the config names.
  const std::vector<EndorsingPeer>& named() {
    if (!named_) {
      named_.emplace();
      for (const ServerKeys& server : one_.ledger->endorsers)
        named_->push_back(peer_at(server, server.msp_id, "[[endorser]]"));
    }
    return *named_;
  }

  /// Whether the gateway finds those whom the policy needs.
  Status gateway() { return endorsable(note_); }

  EndorsingPeer by_gateway(const std::string& msp_id) {
    fabric::Call call = note_;
    call.need = fabric::EndorsementNeed{.count = fabric::EndorsementNeed::Count::one, .organisation = msp_id};
    EndorsingPeer peer{.msp_id = msp_id, .place = "the gateway at " + client_.endpoint, .identity = msp_id};
    if (auto found = endorsable(std::move(call)); !found) peer.why = found.error().message;
    return peer;
  }

 private:
  Status endorsable(fabric::Call call) {
    if (!gateway_) {
      auto made = fabric::Client::create(client_);
      if (!made) return made.error();
      gateway_ = std::move(*made);
    }
    return gateway_->endorsable(std::move(call));
  }

  const ProgramConfig& one_;
  const fabric::ClientConfig& client_;
  const fabric::Call note_;
  std::optional<std::vector<EndorsingPeer>> named_{};
  std::unique_ptr<fabric::Client> gateway_{};
};

/// Past the gateway goes who has orderers and endorsers of two organisations: for what needs two, as the client has it.
bool gathers(const LedgerKeys& keys) {
  std::set<std::string> organisations;
  for (const ServerKeys& one : keys.endorsers) organisations.insert(one.msp_id);
  return !keys.orderers.empty() && organisations.size() >= 2;
}

Finding assess_records(const ProgramConfig& one, const NeededSignatures& needed, EndorserQueries& queries) {
  EndorsementInputs inputs{.program = one.file,
                           .what = fmt::format("new records of contract {}", one.ledger->contract),
                           .policy = needed.policy,
                           .organisations = needed.organisations};
  if (gathers(*one.ledger)) {
    inputs.peers = queries.named();
    return assess(inputs);
  }
  const Status found_by_gateway = queries.gateway();
  if (found_by_gateway)
    return fine("endorsement", fmt::format("{}: {}: the gateway finds enough", one.file, inputs.what));
  inputs.by_gateway = true;
  for (const std::string& msp_id : needed.organisations) inputs.peers.push_back(queries.by_gateway(msp_id));
  const Finding finding = assess(inputs);
  if (finding.problem) return finding;
  return flag(Problem::ledger_refuses, "endorsement",
              fmt::format("{}: {}: {}", one.file, inputs.what, found_by_gateway.error().message));
}

/// What needs the signature of one organisation; one of one's own may be the peer of [ledger].
Finding assess_alone(const ProgramConfig& one, const NeededSignatures& needed, const std::string& msp_id,
                     const std::string& what, EndorserQueries& queries) {
  EndorsementInputs inputs{.program = one.file,
                           .what = what,
                           .policy = {{fabric::peer_policy(msp_id)}, 1},
                           .organisations = needed.organisations};
  if (!one.ledger->orderers.empty())
    for (const EndorsingPeer& peer : queries.named())
      if (peer.said_to_be == msp_id) inputs.peers.push_back(peer);
  if (inputs.peers.empty() && !one.ledger->orderers.empty() && msp_id == one.ledger->msp_id)
    inputs.peers.push_back(queries.peer_at(one.ledger->peer, msp_id, "[ledger]"));
  if (inputs.peers.empty()) {
    inputs.by_gateway = true;
    inputs.peers.push_back(queries.by_gateway(msp_id));
  }
  return assess(inputs);
}

}  // namespace

Findings query_endorsers(const ProgramConfig& one, const fabric::ClientConfig& client, const NeededSignatures& needed) {
  EndorserQueries queries(one, client);
  Findings out{assess_records(one, needed, queries)};
  // States are signed for by a peer of one's own organisation, commands by one of the drones' owner.
  std::set<std::string> alone = needed.owners;
  std::string what = "commands";
  if (one.program == "agent") {
    if (one.ledger->orderers.empty()) return out;
    alone = {one.ledger->msp_id};
    what = "states";
  }
  for (const std::string& msp_id : alone) {
    Finding finding = assess_alone(one, needed, msp_id, fmt::format("{} of the drones of {}", what, msp_id), queries);
    if (finding.problem) out.push_back(std::move(finding));
  }
  return out;
}

}  // namespace ledgerline::checks
