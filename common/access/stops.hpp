#pragma once
#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <tuple>

#include "ledgerline.pb.h"

/// The set of those who have a drone stopped, as contract, agent and ground keep it. Each identity has one stop at
/// most; each clears its own, and no stop comes back that was cleared. Thread-safe as the messages are.
namespace ledgerline {

inline bool same_identity(const Identity& a, const Identity& b) {
  return a.msp_id() == b.msp_id() && a.subject() == b.subject();
}

/// A list with one entry for each identity, in order of MSP id and subject. `whose` is an entry's identity.
template <typename List, typename Whose>
bool remove_entry(List& list, const Identity& who, const Whose& whose) {
  const auto rest =
      std::remove_if(list.begin(), list.end(), [&](const auto& entry) { return same_identity(whose(entry), who); });
  const bool found = rest != list.end();
  list.erase(rest, list.end());
  return found;
}
/// In place of the identity's older one.
template <typename List, typename Entry, typename Whose>
void put_entry(List& list, const Entry& entry, const Whose& whose) {
  remove_entry(list, whose(entry), whose);
  *list.Add() = entry;
  const auto order = [&](const Entry& one) { return std::tie(whose(one).msp_id(), whose(one).subject()); };
  std::sort(list.begin(), list.end(), [&](const Entry& a, const Entry& b) { return order(a) < order(b); });
}

inline const Identity& whose_stop(const Stop& stop) { return stop.stopper(); }

inline bool is_stopped(const Control& control) { return !control.stoppers().empty(); }

/// Whether this stopper has the drone stopped.
inline bool is_stopped_by(const Control& control, const Identity& stopper) {
  return std::any_of(control.stoppers().begin(), control.stoppers().end(),
                     [&](const Stop& one) { return same_identity(one.stopper(), stopper); });
}
/// The motors are to be off: one of the stoppers says so.
inline bool is_cut(const Control& control) {
  return std::any_of(control.stoppers().begin(), control.stoppers().end(), [](const Stop& s) { return s.cut(); });
}

/// What a call says of one of its drones in a list beside them; nothing: it does not say.
inline std::optional<std::uint64_t> said_of(const DronesCall& call,
                                            const google::protobuf::RepeatedField<std::uint64_t>& list,
                                            const std::string& drone) {
  const auto at = std::find(call.drones().begin(), call.drones().end(), drone) - call.drones().begin();
  return at < list.size() ? std::optional(list.Get(static_cast<int>(at))) : std::nullopt;
}

/// How often that stopper's stops were cleared.
inline std::uint64_t clears_of(const Control& control, const Identity& stopper) {
  const auto& all = control.cleared();
  const auto found = std::find_if(all.begin(), all.end(),
                                  [&](const StopClears& one) { return same_identity(one.stopper(), stopper); });
  return found == all.end() ? 0 : found->clears();
}

/// Adds a stop; of the same stopper, the newer word replaces the older one. One that was cleared since it was given is
/// no stop any more, however late it comes.
inline void add_stop(Control& control, const Stop& stop) {
  if (stop.clears() >= clears_of(control, stop.stopper())) put_entry(*control.mutable_stoppers(), stop, whose_stop);
}

/// Stops of a lower count are cleared.
inline void set_clears(Control& control, const Identity& stopper, std::uint64_t clears) {
  StopClears cleared;
  *cleared.mutable_stopper() = stopper;
  cleared.set_clears(clears);
  put_entry(*control.mutable_cleared(), cleared,
            [](const StopClears& one) -> const Identity& { return one.stopper(); });
  const auto& stops = control.stoppers();
  const auto of_stopper = [&](const Stop& one) { return same_identity(one.stopper(), stopper); };
  const auto stop = std::find_if(stops.begin(), stops.end(), of_stopper);
  if (stop != stops.end() && stop->clears() < clears) remove_entry(*control.mutable_stoppers(), stopper, whose_stop);
}

/// Clears everybody's stop for a supervisor of the drone's organisation, else one's own. False: there was none.
inline bool clear_stops(Control& control, const Identity& who, bool supervisor) {
  const bool all = supervisor && control.owner().msp_id() == who.msp_id();
  bool found = all;
  const auto stops = control.stoppers();
  for (const Stop& stop : stops) {
    if (!all && !same_identity(stop.stopper(), who)) continue;
    set_clears(control, stop.stopper(), stop.clears() + 1);
    found = true;
  }
  return found;
}

/// "Org1MSP CN=guard, Org3MSP CN=chief": for messages.
inline std::string stopper_names(const Control& control) {
  std::string names;
  for (const Stop& stop : control.stoppers()) {
    names += (names.empty() ? "" : ", ") + stop.stopper().msp_id() + " " + stop.stopper().subject();
  }
  return names;
}

}  // namespace ledgerline
