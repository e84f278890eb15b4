#include "common/fabric/receipt/members.hpp"

#include <optional>

namespace ledgerline::fabric {

Members::Members(std::vector<crypto::MspRoot> roots, const std::string& lists_pem) {
  for (crypto::MspRoot& root : roots) root.revocation_lists_pem.clear();
  all_ = crypto::make_msp_registry(crypto::Library::libcrypto, roots);
  if (lists_pem.empty()) return;
  for (crypto::MspRoot& root : roots) root.revocation_lists_pem = lists_pem;
  not_revoked_ = crypto::make_msp_registry(crypto::Library::libcrypto, std::move(roots), crypto::ListsFrom::hand);
}

Result<Members::Found> Members::find(std::string_view serialized) const {
  auto member = all_->member(serialized, std::nullopt);
  if (!member) return member.error();
  return Found{std::move(*member), not_revoked_ && !not_revoked_->member(serialized, std::nullopt)};
}

}  // namespace ledgerline::fabric
