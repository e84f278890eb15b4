#include "chaincode/endorser/core/peer_follower.hpp"

#include "common/fabric/tx/form.hpp"
#include "peer/proposal_response.pb.h"

namespace ledgerline::endorser {
namespace {

/// All that a result has read, and nothing that it wrote; empty: it does not parse.
std::string reads_of(const std::string& payload) {
  protos::ProposalResponsePayload parsed;
  protos::ChaincodeAction action;
  if (!parsed.ParseFromString(payload) || !action.ParseFromString(parsed.extension())) return {};
  std::string reads = "read:";
  for (fabric::NamespaceSet& part : fabric::read_sets(action.results()).parts) {
    part.set.clear_writes();
    part.set.clear_metadata_writes();
    reads += part.name + '\0' + part.collection + '\0' + part.set.SerializeAsString() + '\0';
  }
  return reads;
}

}  // namespace

Comparison compare_answers(std::string_view own, std::string_view peers) {
  protos::ProposalResponse mine, theirs;
  if (!mine.ParseFromArray(own.data(), static_cast<int>(own.size())) ||
      !theirs.ParseFromArray(peers.data(), static_cast<int>(peers.size())))
    return Comparison::differ;
  if (mine.payload() == theirs.payload() &&
      mine.response().SerializeAsString() == theirs.response().SerializeAsString() &&
      mine.has_endorsement() == theirs.has_endorsement())
    return Comparison::same;
  // Neither says what it has read: the contract did not run.
  if (mine.payload().empty() && theirs.payload().empty()) return Comparison::other_state;
  return reads_of(mine.payload()) == reads_of(theirs.payload()) ? Comparison::differ : Comparison::other_state;
}

void Readiness::on_connection(bool connected) {
  connected_ = connected;
  height_known_ = false;
  ++connection_;
}

bool Readiness::set_peer_height(std::uint64_t connection, std::uint64_t height) {
  if (connection != connection_) return false;
  peers_height_ = height;
  height_known_ = true;
  return true;
}

Status Readiness::check(std::uint64_t height) const {
  if (failed_) return Error{"the endorser has stopped"};
  if (!connected_ || !height_known_ || height < peers_height_)
    return Error{"the endorser does not have all blocks yet"};
  return done;
}

Status Readiness::record_comparison(Comparison result, const DefinedAt& asked, const DefinedAt& now) {
  apart_ = result == Comparison::other_state ? apart_ + 1 : 0;
  if (result == Comparison::differ) return Error{"its answer to a proposal differs from the peer's"};
  if (result == Comparison::same) {
    agreed_ = asked;
    agreed_once_ = true;
  }
  // Where it has not signed under a definition yet, the peer may just not have approved that: it waits.
  if (has_agreed(now) && apart_ >= max_apart) return Error{"its state is not the peer's"};
  return done;
}

}  // namespace ledgerline::endorser
