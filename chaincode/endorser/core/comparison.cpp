#include "chaincode/endorser/core/comparison.hpp"

#include <string>

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

Comparison compare(std::string_view own, std::string_view peers) {
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

}  // namespace ledgerline::endorser
