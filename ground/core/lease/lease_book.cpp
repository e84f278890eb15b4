#include "ground/core/lease/lease_book.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/access/access.hpp"
#include "common/access/grants.hpp"
#include "common/access/stops.hpp"

namespace ledgerline::ground {

std::string holder_words(const Lease& lease) {
  return lease.holder->subject +
         (lease.commander == lease.holder ? "" : ", who lets " + lease.commander->subject + " command it");
}

LeaseBook::LeaseBook(const FlightConfig& config, FlightTransactions& counters)
    : config_(config), counters_(counters), leases_(config.drones.size()) {
  for (Lease& lease : leases_) update(lease);
}

void LeaseBook::update(Lease& lease) const {
  lease.revoked = lease.record && is_lease_revoked(*lease.record);
  lease.may_command =
      !config_.ledger || (lease.commander == config_.self && !lease.revoked && !is_stopped(lease.stoppers));
}

Result<std::optional<LeaseBook::Change>> LeaseBook::set(const Control& record) {
  const auto drone = index_of(config_.drones, record.drone());
  if (!drone) return Error{fmt::format("a record of {} came, which does not fly here", record.drone())};
  return apply_record(*drone, record);
}

std::optional<LeaseBook::Change> LeaseBook::apply_record(std::size_t drone, const Control& control) {
  Lease& lease = leases_[drone];
  if (control.epoch() < lease.epoch) return std::nullopt;
  const Change change{drone, control.epoch() != lease.epoch};
  lease.record = control;
  lease.epoch = control.epoch();
  lease.owner.reset();
  lease.holder.reset();
  lease.commander.reset();
  *lease.stoppers.mutable_stoppers() = control.stoppers();
  *lease.stoppers.mutable_cleared() = control.cleared();
  if (control.has_owner()) lease.owner = to_name(control.owner());
  if (control.has_holder()) {
    lease.holder = to_name(control.holder());
    lease.commander = to_name(commander_of(control));
  }
  update(lease);
  return change;
}

// Who signed it; nobody who is trusted: none.
std::optional<access::Caller> LeaseBook::creator_of(const fabric::Transaction& tx, std::int64_t realtime_s) const {
  const auto member = config_.trusted->member(tx.creator, realtime_s);
  if (!member || !fabric::verify_signature(tx, *(*member)->verifier)) return std::nullopt;
  return access::Caller{(*member)->name, (*member)->admin};
}

std::vector<LeaseBook::Change> LeaseBook::on_event(const fabric::Transaction& tx, std::int64_t realtime_s) {
  const auto event = verification::read_control_event({tx.function, tx.args}, tx.event_name, tx.event_payload);
  if (!event) {
    ++counters_.altered;
    return {};
  }
  const auto ours = [&](const auto& all) {
    return std::any_of(all.begin(), all.end(), [&](const auto& one) { return index_of(config_.drones, one.drone()); });
  };
  const auto role = verification::role_change(*event);
  const bool role_of_ours = role && std::ranges::any_of(leases_, [&](const Lease& lease) {
                              return lease.record && names_identity(*lease.record, role->identity);
                            });
  if (!ours(event->controls.controls()) && !ours(event->stops.stops()) && !role_of_ours) return {};
  std::optional<access::Caller> creator;
  if (config_.trusted && !(creator = creator_of(tx, realtime_s))) {
    ++counters_.states_unverified;
    return {};
  }
  std::vector<Change> changes;
  if (role && creator && !verification::role_follows(*event, *creator)) {
    ++counters_.altered;
    return {};
  }
  for (const Control& control : event->controls.controls()) {
    const auto drone = index_of(config_.drones, control.drone());
    if (!drone) continue;
    const auto& record = leases_[*drone].record;
    if (creator && !(record && verification::control_follows(*event, *record, control, *creator))) {
      ++counters_.altered;
    } else if (const auto change = apply_record(*drone, control)) {
      changes.push_back(*change);
    }
  }
  for (std::size_t drone = 0; role && drone < leases_.size(); ++drone) {
    Lease& lease = leases_[drone];
    if (!lease.record || !names_identity(*lease.record, role->identity)) continue;
    apply_role(*lease.record, role->identity, role->role);
    update(lease);
    changes.push_back({drone, false});
  }
  for (const Stop& stop : event->stops.stops()) {
    const auto drone = index_of(config_.drones, stop.drone());
    if (!drone) continue;
    Lease& lease = leases_[*drone];
    if (creator && !verification::stop_follows(*event, lease.record.value_or(Control()), stop, *creator)) {
      ++counters_.altered;
      continue;
    }
    add_stop(lease.stoppers, stop);
    if (lease.record) add_stop(*lease.record, stop);
    update(lease);
    changes.push_back({*drone, false});
  }
  return changes;
}

}  // namespace ledgerline::ground
