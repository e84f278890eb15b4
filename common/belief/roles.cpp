#include "common/belief/roles.hpp"

#include "common/belief/identity.hpp"
#include "common/msg/proto_json.hpp"

namespace ledgerline::belief {

void Roles::take(const RoleChange& change) { roles_[to_name(change.identity)] = change.role; }

Role Roles::of(const crypto::IdentityName& who) const {
  const auto found = roles_.find(who);
  return found == roles_.end() ? ROLE_NONE : found->second;
}

Result<Roles> read_roles(const Evaluate& evaluate) {
  Roles roles;
  std::size_t count = 0;
  const Status status = read_all("role", evaluate, [&](const Asset& asset) -> Status {
    if (++count > max_roles) return Error{"the ledger has more than " + std::to_string(max_roles) + " roles"};
    EnrollCall record;
    if (auto parsed = parse_message(asset.msg_data(), record); !parsed) return parsed;
    roles.take({record.identity(), record.role()});
    return done;
  });
  if (!status) return Error{"the roles: " + status.error().what};
  return roles;
}

}  // namespace ledgerline::belief
