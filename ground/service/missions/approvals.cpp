#include "ground/service/missions/approvals.hpp"

#include <algorithm>

#include "common/access/access.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/grants.hpp"
#include "common/msg/proto_json.hpp"

namespace ledgerline::ground::service {

std::vector<crypto::IdentityName> operators_in(const Anchors& anchors, const verification::Roles& roles) {
  std::vector<crypto::IdentityName> signers;
  for (const Anchor& anchor : anchors.anchors()) {
    const crypto::IdentityName signer = to_name(anchor.signer());
    if (is_operator(roles.of(signer))) signers.push_back(signer);
  }
  return signers;
}

std::vector<AnchorCall> approval_questions(const std::string& digest, const verification::Roles& roles) {
  std::vector<AnchorCall> calls;
  for (const auto& [who, role] : roles.all()) {
    if (!is_operator(role)) continue;
    if (calls.empty() || static_cast<std::size_t>(calls.back().signers_size()) == contract::max_page_anchors)
      calls.emplace_back().set_digest(digest);
    *calls.back().add_signers() = to_message(who);
  }
  return calls;
}

std::vector<std::string> anchored_in(const fabric::Block& block, const MissionBook& book, const ApprovalTerms& terms,
                                     std::int64_t unix_s) {
  std::vector<std::string> ids;
  for (const fabric::Transaction& tx : block.transactions) {
    if (tx.code != 0 || tx.config || tx.event_name != contract::anchor) continue;
    AnchorCall anchored;
    if (!parse_message(tx.event_payload, anchored)) continue;
    for (const std::string& id : book.ids()) {
      const auto is_it = [&](const crypto::Digest& digest) {
        return anchored.digest() == std::string(digest.begin(), digest.end());
      };
      const auto digests = terms.now(book.digest(id), unix_s);
      const bool concerns = std::any_of(digests.begin(), digests.end(), [&](const ApprovalTerms::Digests& one) {
        return is_it(one.approval) || is_it(one.withdrawal);
      });
      if (concerns) ids.push_back(id);
    }
  }
  return ids;
}

bool changes_roles(const fabric::Block& block) {
  return std::any_of(block.transactions.begin(), block.transactions.end(), [](const fabric::Transaction& tx) {
    return tx.code == 0 && !tx.config && (tx.event_name == contract::enroll || tx.event_name == contract::revoke);
  });
}

mission::Finding not_checked() {
  mission::Finding finding;
  finding.words = "it was not checked: too many missions wait to be looked at";
  return finding;
}

std::vector<std::string> Unread::take(TimeNs now) {
  std::vector<std::string> due;
  for (auto one = when_.begin(); one != when_.end();) {
    if (now < one->second) {
      ++one;
      continue;
    }
    due.push_back(one->first);
    one = when_.erase(one);
  }
  return due;
}

}  // namespace ledgerline::ground::service
