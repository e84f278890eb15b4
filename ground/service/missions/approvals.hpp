#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/rt/clock.hpp"
#include "common/verification/control_records.hpp"
#include "ground/service/missions/book.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground::service {

/// What an approval is for: one mission, at one ground, for a while. It is an anchor of a digest that is made of all
/// three, so it counts nowhere else and ends; its withdrawal is an anchor of another one. The ledger takes one anchor
/// of a digest from each signer, so who has withdrawn approves again in the next period. Pure.
class ApprovalTerms {
 public:
  /// An approval expires after between lasts_s / 2 and lasts_s, so two periods are checked.
  ApprovalTerms(crypto::IdentityName ground, std::int64_t lasts_s) : ground_(std::move(ground)), lasts_s_(lasts_s) {}

  struct Digests {
    crypto::Digest approval{}, withdrawal{};
  };
  /// Of the period that is now, and of the one before.
  std::array<Digests, 2> now(const crypto::Digest& mission, std::int64_t unix_s) const;
  /// Changes when the approvals of another period count.
  std::int64_t period(std::int64_t unix_s) const { return unix_s / (lasts_s_ / 2); }

  /// Anchored beside the digest. Text for people; only the digest counts.
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

/// Who of those that anchored a digest is an operator or a supervisor now.
std::vector<crypto::IdentityName> operators_in(const Anchors& anchors, const verification::RolesByOrganisation& roles);

/// Calls of verify that ask for those who may approve a digest by their own keys, so that no other identity's
/// anchors of it stand in the way: operators and supervisors of these roles, as many a call as it answers.
std::vector<AnchorCall> approval_questions(const std::string& digest, const verification::RolesByOrganisation& roles);

/// Ids of the missions that a block approves, or of which it withdraws an approval, valid: their approvals are to be
/// read again. Events are not trusted; approvals are read from the ledger.
std::vector<std::string> anchored_in(const fabric::Block& block, const MissionBook& book, const ApprovalTerms& terms,
                                     std::int64_t unix_s);

/// Whether a block, valid, changes somebody's role: then it must be read again whose approval counts and who may sign.
bool changes_roles(const fabric::Block& block);

/// What speaks against a mission that could not be checked now.
mission::Finding not_checked();

/// Missions whose approvals could not be read: when they are asked for again. Deterministic; one thread.
class Unread {
 public:
  static constexpr TimeNs again_ns = 2 * ns_per_s;

  void add(const std::string& id, TimeNs now) { when_[id] = now + again_ns; }
  bool empty() const { return when_.empty(); }
  /// Those that are due, which are forgotten with that.
  std::vector<std::string> pop_due(TimeNs now);

 private:
  std::map<std::string, TimeNs> when_;
};

}  // namespace ledgerline::ground::service
