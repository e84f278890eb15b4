#pragma once
#include <map>

#include "common/belief/control_events.hpp"
#include "common/belief/control_records.hpp"

namespace ledgerline::belief {

/// The roles that organisations have given to their people, as the ledger's records say at first and its events from then
/// on. One thread.
class Roles {
 public:
  void take(const RoleChange& change);
  Role of(const crypto::IdentityName& who) const;
  const std::map<crypto::IdentityName, Role>& all() const { return roles_; }

 private:
  std::map<crypto::IdentityName, Role> roles_;
};

/// All of the ledger's records of roles; an error, too, where there are more than max_roles.
Result<Roles> read_roles(const Evaluate& evaluate);
/// A hundred times what a channel of three organisations with a drone school each has.
inline constexpr std::size_t max_roles = 10'000;

}  // namespace ledgerline::belief
