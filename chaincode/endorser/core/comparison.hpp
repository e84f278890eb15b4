#pragma once
#include <string_view>

namespace ledgerline::endorser {

/// What the endorser's answer is beside a peer's to the same proposal.
enum class Comparison {
  same,         ///< byte for byte, but for the signature
  other_state,  ///< they have read other versions: one of them has not taken a block yet
  differ,       ///< from the same versions they conclude different things: one of them must not go on
};
/// Both are protos.ProposalResponse. Pure.
Comparison compare(std::string_view own, std::string_view peers);

}  // namespace ledgerline::endorser
