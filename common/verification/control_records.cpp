#include "common/verification/control_records.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/access/access.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"

namespace ledgerline::verification {

Status read_pages(const std::string& id, const Evaluate& evaluate, const std::function<Status(const Assets&)>& take) {
  QueryCall query;
  query.set_id(id);
  do {
    const auto answer = evaluate({.function = contract::get, .args = {query.SerializeAsString()}});
    if (!answer) return answer.error();
    Assets page;
    if (auto status = parse_message(*answer, page); !status) return status;
    // Each is the last id of its page, and ids come in their order: a peer that goes in circles is seen.
    if (!page.bookmark().empty() && page.bookmark() <= query.bookmark()) return Error{"the ledger's pages do not end"};
    if (auto status = take(page); !status) return status;
    query.set_bookmark(page.bookmark());
  } while (!query.bookmark().empty());
  return done;
}

Status read_all(const std::string& kind, const Evaluate& evaluate, const std::function<Status(const Asset&)>& take) {
  return read_pages(kind + "/*", evaluate, [&](const Assets& page) -> Status {
    for (const Asset& asset : page.assets()) {
      if (auto status = take(asset); !status) return status;
    }
    return done;
  });
}

Result<Control> read_control(const std::string& drone, const Evaluate& evaluate) {
  QueryCall query;
  query.set_id("control/" + drone);
  const auto answer = evaluate({.function = contract::get, .args = {query.SerializeAsString()}});
  if (!answer) return Error{fmt::format("control/{}: {}", drone, answer.error().message)};
  Assets assets;
  Control control;
  if (auto status = parse_message(*answer, assets); !status) return status.error();
  if (assets.assets_size() != 1) return Error{drone + " is not enrolled: enroll it first (ledgerline fly does)"};
  if (auto status = parse_message(assets.assets(0).msg_data(), control); !status) return status.error();
  if (control.drone() != drone) return Error{fmt::format("control/{} is the record of another", drone)};
  return control;
}

Result<std::vector<Control>> read_controls(const std::vector<std::string>& drones, const Evaluate& evaluate) {
  std::vector<Control> controls;
  for (const std::string& drone : drones) {
    auto control = read_control(drone, evaluate);
    if (!control) return control.error();
    controls.push_back(std::move(control).value());
  }
  return controls;
}

Status read_repeatedly(const std::stop_token& stop, const std::function<Status()>& read, const TryWorld& world) {
  return retry(
      "the control records can be read (no block is taken before)",
      {.within_ns = max_controls_wait_ns, .first_pause_ns = 50 * ns_per_ms, .max_pause_ns = 500 * ns_per_ms},
      [&] { return stop.stop_requested(); }, read, world);
}

Result<std::vector<Control>> read_controls_repeatedly(const std::stop_token& stop,
                                                      const std::vector<std::string>& drones, const Evaluate& evaluate,
                                                      const TryWorld& world) {
  std::vector<Control> read;
  const auto once = [&]() -> Status {
    auto controls = read_controls(drones, evaluate);
    if (!controls) return controls.error();
    read = std::move(controls).value();
    return done;
  };
  if (auto status = read_repeatedly(stop, once, world); !status) return status.error();
  return read;
}

Result<ControlStart::Next> ControlStart::on_block(const fabric::Block& block) {
  if (known_) return Next::take;
  if (held_.size() >= max_held_) {
    return Error{fmt::format("the control records could not be read while {} blocks came: see the messages above",
                             held_.size())};
  }
  held_.push_back(block);
  return std::exchange(reading_, true) ? Next::hold : Next::read;
}

void ControlStart::forget() {
  held_.clear();
  forgotten_ = true;
}

void ControlStart::restart() {
  held_.clear();
  reading_ = forgotten_ = false;
}

std::vector<fabric::Block> ControlStart::on_read() {
  known_ = true;
  return std::exchange(held_, {});
}

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
Result<bool> read_tables(const Evaluate& evaluate, const std::string& msp_id, RolesByOrganisation& roles) {
  bool there = false;
  std::size_t records = 0;
  const Error enough{"enough", ErrorCode::cancelled};
  const Status status = read_all(std::string(kind) + msp_id, evaluate, [&](const Asset& asset) -> Status {
    if (++records > contract::role_tables) {  // what is behind them is none of the contract's
      roles.exclude(msp_id);
      return enough;
    }
    if (!is_table_key(asset.id(), msp_id)) return done;
    there = true;
    RoleTable table;
    if (asset.msg_data().size() > contract::max_table_bytes || !parse_message(asset.msg_data(), table) ||
        static_cast<std::size_t>(table.entries_size()) > contract::max_table_entries) {
      roles.exclude(msp_id);
      return enough;
    }
    for (const RoleTable::Entry& entry : table.entries())
      roles.apply({to_message({msp_id, entry.subject()}), entry.role()});
    return done;
  });
  if (!status && status.error().code != ErrorCode::cancelled) return status.error();
  return there || roles.left_out().contains(msp_id);
}

/// Of organisations that have written no role since the version before.
Status read_records_before(const Evaluate& evaluate, const Organisations& organisations, RolesByOrganisation& roles) {
  std::size_t records = 0;
  const Error enough{"enough", ErrorCode::cancelled};
  const Status status = read_all("role", evaluate, [&](const Asset& asset) -> Status {
    if (++records > max_records_before) {
      for (const std::string& msp_id : organisations) roles.exclude(msp_id);
      return enough;
    }
    EnrollCall record;
    const bool before = asset.id().find('/', kind.size()) == std::string::npos;
    if (before && parse_message(asset.msg_data(), record) && organisations.contains(record.identity().msp_id()))
      roles.apply({record.identity(), record.role()});
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

void RolesByOrganisation::await(const std::string& msp_id) {
  organisations_[msp_id];
  awaited_.insert(msp_id);
}

Organisations RolesByOrganisation::followed() const {
  Organisations followed;
  for (const auto& [msp_id, roles] : organisations_) {
    if (!awaited_.contains(msp_id)) followed.insert(msp_id);
  }
  return followed;
}

void RolesByOrganisation::apply(const RoleChange& change) {
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

void RolesByOrganisation::add(const RolesByOrganisation& read) {
  for (const auto& [msp_id, roles] : read.organisations_) {
    auto& ours = organisations_[msp_id];
    for (const auto& [subject, role] : roles) {
      if (ours.size() < contract::max_organisation_roles) ours.try_emplace(subject, role);
    }
    awaited_.erase(msp_id);
  }
  left_out_.insert(read.left_out_.begin(), read.left_out_.end());
}

void RolesByOrganisation::exclude(const std::string& msp_id) {
  organisations_[msp_id].clear();
  left_out_.insert(msp_id);
}

Role RolesByOrganisation::of(const crypto::IdentityName& who) const {
  const auto organisation = organisations_.find(who.msp_id);
  if (organisation == organisations_.end()) return ROLE_NONE;
  const auto found = organisation->second.find(who.subject);
  return found == organisation->second.end() ? ROLE_NONE : found->second;
}

std::map<crypto::IdentityName, Role> RolesByOrganisation::all() const {
  std::map<crypto::IdentityName, Role> all;
  for (const auto& [msp_id, roles] : organisations_) {
    for (const auto& [subject, role] : roles) all.emplace(crypto::IdentityName{msp_id, subject}, role);
  }
  return all;
}

Result<RolesByOrganisation> read_roles(const Evaluate& evaluate, const Organisations& organisations) {
  RolesByOrganisation roles;
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
