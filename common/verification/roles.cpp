#include "common/verification/roles.hpp"

#include "common/access/identity.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"

namespace ledgerline::verification {
namespace {

constexpr std::string_view kind = "role/";
/// Of the version before, where everybody's stood in one list: more of them are not looked at. A thousand times what a
/// channel of three organisations with a drone school each has.
constexpr std::size_t max_records_before = 100'000;

bool is_table_key(std::string_view id, const std::string& msp_id) {
  return id.size() == kind.size() + msp_id.size() + 2 && id.starts_with(kind) &&
         id.substr(kind.size(), msp_id.size()) == msp_id && id[id.size() - 2] == '/';
}

/// Whether the organisation has tables.
Result<bool> read_tables(const Evaluate& evaluate, const std::string& msp_id, Roles& roles) {
  bool there = false;
  std::size_t records = 0;
  const Error enough{"enough", ErrorCode::cancelled};
  const Status status = read_all(std::string(kind) + msp_id, evaluate, [&](const Asset& asset) -> Status {
    if (++records > contract::role_tables) {  // what is behind them is none of the contract's
      roles.leave_out(msp_id);
      return enough;
    }
    if (!is_table_key(asset.id(), msp_id)) return done;
    there = true;
    RoleTable table;
    if (asset.msg_data().size() > contract::max_table_bytes || !parse_message(asset.msg_data(), table) ||
        static_cast<std::size_t>(table.entries_size()) > contract::max_table_entries) {
      roles.leave_out(msp_id);
      return enough;
    }
    for (const RoleTable::Entry& entry : table.entries())
      roles.take({to_message({msp_id, entry.subject()}), entry.role()});
    return done;
  });
  if (!status && status.error().code != ErrorCode::cancelled) return status.error();
  return there || roles.left_out().contains(msp_id);
}

/// Of organisations that have written no role since the version before.
Status read_records_before(const Evaluate& evaluate, const Organisations& organisations, Roles& roles) {
  std::size_t records = 0;
  const Error enough{"enough", ErrorCode::cancelled};
  const Status status = read_all("role", evaluate, [&](const Asset& asset) -> Status {
    if (++records > max_records_before) {
      for (const std::string& msp_id : organisations) roles.leave_out(msp_id);
      return enough;
    }
    EnrollCall record;
    const bool before = asset.id().find('/', kind.size()) == std::string::npos;
    if (before && parse_message(asset.msg_data(), record) && organisations.contains(record.identity().msp_id()))
      roles.take({record.identity(), record.role()});
    return done;
  });
  return status || status.error().code == ErrorCode::cancelled ? Status(done) : status;
}

}  // namespace

Organisations organisations_of(const std::vector<Control>& controls) {
  Organisations organisations;
  for (const Control& control : controls) {
    organisations.insert(control.owner().msp_id());
    for (const Grant& grant : control.grants()) organisations.insert(grant.to().msp_id());
  }
  return organisations;
}

void Roles::await(const std::string& msp_id) {
  organisations_[msp_id];
  awaited_.insert(msp_id);
}

Organisations Roles::followed() const {
  Organisations followed;
  for (const auto& [msp_id, roles] : organisations_) {
    if (!awaited_.contains(msp_id)) followed.insert(msp_id);
  }
  return followed;
}

void Roles::take(const RoleChange& change) {
  auto& roles = organisations_[change.identity.msp_id()];
  const auto known = roles.find(change.identity.subject());
  if (known != roles.end()) {
    known->second = change.role;
  } else if (roles.size() < contract::max_organisation_roles) {
    roles.emplace(change.identity.subject(), change.role);
  } else {
    left_out_.insert(change.identity.msp_id());
  }
}

void Roles::add(const Roles& read) {
  for (const auto& [msp_id, roles] : read.organisations_) {
    auto& ours = organisations_[msp_id];
    for (const auto& [subject, role] : roles) {
      if (ours.size() < contract::max_organisation_roles) ours.try_emplace(subject, role);
    }
    awaited_.erase(msp_id);
  }
  left_out_.insert(read.left_out_.begin(), read.left_out_.end());
}

void Roles::leave_out(const std::string& msp_id) {
  organisations_[msp_id].clear();
  left_out_.insert(msp_id);
}

Role Roles::of(const crypto::IdentityName& who) const {
  const auto organisation = organisations_.find(who.msp_id);
  if (organisation == organisations_.end()) return ROLE_NONE;
  const auto found = organisation->second.find(who.subject);
  return found == organisation->second.end() ? ROLE_NONE : found->second;
}

std::map<crypto::IdentityName, Role> Roles::all() const {
  std::map<crypto::IdentityName, Role> all;
  for (const auto& [msp_id, roles] : organisations_) {
    for (const auto& [subject, role] : roles) all.emplace(crypto::IdentityName{msp_id, subject}, role);
  }
  return all;
}

Result<Roles> read_roles(const Evaluate& evaluate, const Organisations& organisations) {
  Roles roles;
  Organisations before;
  for (const std::string& msp_id : organisations) {
    roles.follow(msp_id);
    const auto there = read_tables(evaluate, msp_id, roles);
    if (!there) return Error{"the roles of " + msp_id + ": " + there.error().message};
    if (!*there) before.insert(msp_id);
  }
  if (before.empty()) return roles;
  if (const Status status = read_records_before(evaluate, before, roles); !status)
    return Error{"the roles: " + status.error().message};
  return roles;
}

}  // namespace ledgerline::verification
