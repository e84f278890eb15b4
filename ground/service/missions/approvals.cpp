#include "ground/service/missions/approvals.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <algorithm>

#include "common/access/access.hpp"
#include "common/access/grants.hpp"
#include "common/base/text.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"

namespace ledgerline::ground::service {

std::vector<crypto::IdentityName> operators_in(const Anchors& anchors, const verification::RolesByOrganisation& roles) {
  std::vector<crypto::IdentityName> signers;
  for (const Anchor& anchor : anchors.anchors()) {
    const crypto::IdentityName signer = to_name(anchor.signer());
    if (is_operator(roles.of(signer))) signers.push_back(signer);
  }
  return signers;
}

std::vector<AnchorCall> approval_questions(const std::string& digest, const verification::RolesByOrganisation& roles) {
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
      const bool concerns = std::ranges::any_of(
          digests, [&](const ApprovalTerms::Digests& one) { return is_it(one.approval) || is_it(one.withdrawal); });
      if (concerns) ids.push_back(id);
    }
  }
  return ids;
}

bool changes_roles(const fabric::Block& block) {
  return std::ranges::any_of(block.transactions, [](const fabric::Transaction& tx) {
    return tx.code == 0 && !tx.config && (tx.event_name == contract::enroll || tx.event_name == contract::revoke);
  });
}

mission::Finding not_checked() {
  mission::Finding finding;
  finding.words = "it was not checked: too many missions wait to be looked at";
  return finding;
}

std::vector<std::string> Unread::pop_due(TimeNs now) {
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

namespace {

constexpr std::size_t max_ground_chars = 120;  // an anchor's words are bounded, and an identity's name may be long

/// A line for each part: none of them can have a line's end, so no two texts are the same for different parts.
crypto::Digest digest_of(const char* what, const crypto::Digest& mission, const crypto::IdentityName& ground,
                         std::int64_t lasts_s, std::int64_t period) {
  return crypto::sha256(fmt::format("ledgerline mission {} 1\n{}\n{}\n{}\n{}\n{}\n", what, crypto::hex(mission),
                                    ground.msp_id, ground.subject, lasts_s, period));
}

bool has(const std::vector<crypto::IdentityName>& all, const crypto::IdentityName& one) {
  return std::ranges::find(all, one) != all.end();
}

}  // namespace

std::array<ApprovalTerms::Digests, 2> ApprovalTerms::now(const crypto::Digest& mission, std::int64_t unix_s) const {
  const auto of = [&](std::int64_t period) {
    return Digests{digest_of("approval", mission, ground_, lasts_s_, period),
                   digest_of("withdrawal", mission, ground_, lasts_s_, period)};
  };
  return {of(period(unix_s)), of(period(unix_s) - 1)};
}

std::string ApprovalTerms::approval_words(const std::string& mission, std::int64_t unix_s) const {
  const std::int64_t end_s = (period(unix_s) + 2) * (lasts_s_ / 2);
  return fmt::format("mission {} may be flown until {:%Y-%m-%dT%H:%M:%SZ} at {}", mission, fmt::gmtime(end_s),
                     printable(ground_.msp_id + " " + ground_.subject, max_ground_chars));
}

std::string ApprovalTerms::withdrawal_words(const std::string& mission) const {
  return fmt::format("mission {} may not be flown any more at {}", mission,
                     printable(ground_.msp_id + " " + ground_.subject, max_ground_chars));
}

std::vector<crypto::IdentityName> standing_approvals(std::span<const PeriodSigners> newest_first) {
  std::vector<crypto::IdentityName> standing, withdrawn;
  for (const PeriodSigners& period : newest_first) {
    withdrawn.insert(withdrawn.end(), period.withdrawn.begin(), period.withdrawn.end());
    for (const crypto::IdentityName& signer : period.approved) {
      if (!has(withdrawn, signer) && !has(standing, signer)) standing.push_back(signer);
    }
  }
  return standing;
}

}  // namespace ledgerline::ground::service
