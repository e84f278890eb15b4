#include "ground/service/missions/approvals.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>

#include "common/base/text.hpp"

namespace ledgerline::ground::service {
namespace {

constexpr std::size_t max_ground_chars = 120;  // an anchor's words are bounded, and an identity's name may be long

/// A line for each part: none of them can have a line's end, so no two texts are the same for different parts.
crypto::Digest digest_of(const char* what, const crypto::Digest& mission, const crypto::IdentityName& ground,
                         std::int64_t lasts_s, std::int64_t period) {
  return crypto::sha256(fmt::format("ledgerline mission {} 1\n{}\n{}\n{}\n{}\n{}\n", what, crypto::hex(mission),
                                    ground.msp_id, ground.subject, lasts_s, period));
}

bool has(const std::vector<crypto::IdentityName>& all, const crypto::IdentityName& one) {
  return std::find(all.begin(), all.end(), one) != all.end();
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
