#include "chaincode/endorser/core/readiness.hpp"

namespace ledgerline::endorser {

void Readiness::on_connection(bool connected) {
  connected_ = connected;
  height_known_ = false;
  ++connection_;
}

bool Readiness::take_height(std::uint64_t connection, std::uint64_t height) {
  if (connection != connection_) return false;
  peers_height_ = height;
  height_known_ = true;
  return true;
}

std::string Readiness::why_not(std::uint64_t height) const {
  if (failed_) return "the endorser has stopped";
  if (!connected_ || !height_known_ || height < peers_height_) return "the endorser does not have all blocks yet";
  return {};
}

std::string Readiness::take_check(Comparison found, const DefinedAt& asked, const DefinedAt& now) {
  apart_ = found == Comparison::other_state ? apart_ + 1 : 0;
  if (found == Comparison::differ) return "its answer to a proposal differs from the peer's";
  if (found == Comparison::same) {
    agreed_ = asked;
    agreed_once_ = true;
  }
  // Where it has not signed under a definition yet, the peer may just not have approved that: it waits.
  return agreed(now) && apart_ >= max_apart ? "its state is not the peer's" : "";
}

}  // namespace ledgerline::endorser
