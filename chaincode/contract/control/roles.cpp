#include <algorithm>
#include <array>

#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// Who has which role: the tables of an organisation. No member of another organisation can fill them. Reading a role
/// reads one key.
namespace ledgerline::chaincode {
namespace {

using Tables = std::array<RoleTable, contract::role_tables>;
using Entries = google::protobuf::RepeatedPtrField<RoleTable::Entry>;

Entries::iterator place_of(Entries& entries, const std::string& subject) {
  return std::lower_bound(
      entries.begin(), entries.end(), subject,
      [](const RoleTable::Entry& entry, const std::string& sought) { return entry.subject() < sought; });
}

Role role_in(const RoleTable& table, const std::string& subject) {
  for (const RoleTable::Entry& entry : table.entries()) {
    if (entry.subject() == subject) return entry.role();
  }
  return ROLE_NONE;
}

/// An error: it has no place. One that is there keeps its place whatever its role becomes.
Status put_role(RoleTable& table, const crypto::IdentityName& who, Role role) {
  Entries& entries = *table.mutable_entries();
  const auto place = place_of(entries, who.subject);
  if (place != entries.end() && place->subject() == who.subject) {
    place->set_role(role);
    return done;
  }
  RoleTable::Entry entry;
  entry.set_subject(who.subject);
  entry.set_role(role);
  // A revocation is not kept out by those who were enrolled.
  const bool revokes = role == REVOKED;
  const std::size_t places = revokes ? contract::max_table_entries : contract::max_table_roles;
  const std::size_t bytes = revokes ? contract::max_table_bytes : contract::max_table_bytes / 2;
  if (static_cast<std::size_t>(entries.size()) >= places || table.ByteSizeLong() + entry.ByteSizeLong() > bytes) {
    return Error{who.msp_id + " has no place for a role of " + who.subject + ": the table that it would be in has " +
                 std::to_string(entries.size()) + " of " + std::to_string(places) + " identities, in " +
                 std::to_string(table.ByteSizeLong()) + " of " + std::to_string(bytes) +
                 " bytes. Enroll one that has had a role before, or another name"};
  }
  const auto at = place - entries.begin();
  *entries.Add() = std::move(entry);
  std::rotate(entries.begin() + at, entries.end() - 1, entries.end());
  return done;
}

bool is_key_before(const std::string& key) {
  constexpr std::size_t prefix = 5, digits = 64;  // "role/" and a SHA-256
  return key.size() == prefix + digits && key.find_first_not_of("0123456789abcdef", prefix) == std::string::npos;
}

/// An organisation's roles as the version before kept them. What has no place any more is left out: those who may do
/// something go first, and revocations have places of their own.
Result<Tables> tables_before(Stub& stub, const std::string& msp_id) {
  constexpr std::size_t step = 64;
  std::vector<EnrollCall> records;
  std::string start = "role/0";
  for (;;) {
    const auto some = stub.get_range(start, "role/g", step);
    if (!some) return some.error();
    for (const KeyValue& entry : *some) {
      if (!is_key_before(entry.key)) continue;  // a table of an organisation whose name begins with such a digit
      auto record = parse_record<EnrollCall>(entry);
      if (!record) continue;  // a record that does not parse holds nobody up
      const bool fits =
          record->identity().msp_id() == msp_id && entry.key == role_key_before(to_name(record->identity()));
      if (fits) records.push_back(std::move(*record));
    }
    if (some->size() < step) break;
    start = some->back().key + '\0';
  }
  const auto rank = [](const EnrollCall& record) {
    return record.role() == AUDITOR ? 1 : record.role() == REVOKED ? 2 : 0;
  };
  std::ranges::stable_sort(records, {}, rank);
  Tables tables;
  for (const EnrollCall& record : records) {
    const crypto::IdentityName who = to_name(record.identity());
    (void)put_role(tables[role_table_of(who)], who, record.role());
  }
  return tables;
}

/// All of an organisation's tables at once: its peer's policy is on each from then on, so nobody else makes one.
Status make_tables(Stub& stub, const crypto::IdentityName& first, Role role) {
  auto tables = tables_before(stub, first.msp_id);
  if (!tables) return tables.error();
  if (role != ROLE_NONE) {
    if (Status status = put_role((*tables)[role_table_of(first)], first, role); !status) return status;
  }
  for (std::size_t i = 0; i < tables->size(); ++i) {
    if (Status status = make_record(stub, role_table_key(first.msp_id, i), (*tables)[i], first.msp_id); !status)
      return status;
  }
  return done;
}

}  // namespace

Result<Role> read_role(Stub& stub, const crypto::IdentityName& who) {
  const auto table = read_record<RoleTable>(stub, role_table_key(who.msp_id, role_table_of(who)));
  if (!table) return table.error();
  if (*table) return role_in(**table, who.subject);
  // Its organisation has written no role since the version before: that one's record counts until it does.
  const auto before = read_record<EnrollCall>(stub, role_key_before(who));
  if (!before) return before.error();
  return *before ? (*before)->role() : ROLE_NONE;
}

Status write_role(Stub& stub, const crypto::IdentityName& who, Role role) {
  const std::string key = role_table_key(who.msp_id, role_table_of(who));
  auto table = read_versioned<RoleTable>(stub, key);
  if (!table) return table.error();
  if (!*table) return make_tables(stub, who, role);
  if (role == ROLE_NONE) return done;
  RoleTable& now = (*table)->message;
  const std::string before = now.SerializeAsString();
  if (Status status = put_role(now, who, role); !status) return status;
  if (now.SerializeAsString() == before) return done;
  return write_record(stub, key, now, (*table)->version);
}

}  // namespace ledgerline::chaincode
