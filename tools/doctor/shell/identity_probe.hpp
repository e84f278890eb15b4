#pragma once
#include "tools/doctor/core/identity.hpp"
#include "tools/doctor/shell/configs.hpp"

namespace ledgerline::doctor {

IdentityFacts read_identity(const LedgerKeys& keys);

/// The trust anchor, or why there is none; and the organisations that it names.
struct AnchorFacts {
  std::string block{};  ///< bytes; empty: not read
  std::vector<AuthorityFacts> organisations{};
  bool embedded = false;
};
/// Adds to `findings` what is wrong with it.
AnchorFacts read_anchor(const LedgerKeys& keys, const std::string& program, Findings& findings);

TrustFacts read_trust(const LedgerKeys& keys, const std::string& program, const AnchorFacts& anchor);

}  // namespace ledgerline::doctor
