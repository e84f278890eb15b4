#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"

namespace ledgerline::ground::service {

/// What an approval is for: one mission, at one ground, for a while. It is an anchor of a digest that is made of all
/// three, so it counts nowhere else and ends; its withdrawal is an anchor of another one. The ledger takes one anchor
/// of a digest from each signer, so who has withdrawn approves again in the next period. Pure.
class ApprovalTerms {
 public:
  /// `lasts_s`: an approval ends when it is so old at most, and half of it at least: two periods are looked at.
  ApprovalTerms(crypto::IdentityName ground, std::int64_t lasts_s) : ground_(std::move(ground)), lasts_s_(lasts_s) {}

  struct Digests {
    crypto::Digest approval{}, withdrawal{};
  };
  /// Of the period that is now, and of the one before.
  std::array<Digests, 2> now(const crypto::Digest& mission, std::int64_t unix_s) const;
  /// Changes when the approvals of another period count.
  std::int64_t period(std::int64_t unix_s) const { return unix_s / (lasts_s_ / 2); }

  /// What is anchored beside the digest, for people: nobody's approval counts by its words.
  std::string approval_words(const std::string& mission, std::int64_t unix_s) const;
  std::string withdrawal_words(const std::string& mission) const;

 private:
  const crypto::IdentityName ground_;
  const std::int64_t lasts_s_;
};

/// Who has anchored a period's two digests.
struct PeriodSigners {
  std::vector<crypto::IdentityName> approved{}, withdrawn{};
};
/// Whose approval stands; `newest_first`. A withdrawal ends the approvals of its own period and of those before.
std::vector<crypto::IdentityName> standing_approvals(std::span<const PeriodSigners> newest_first);

}  // namespace ledgerline::ground::service
