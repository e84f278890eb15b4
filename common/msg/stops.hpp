#pragma once
#include <algorithm>
#include <string>
#include <tuple>

#include "ledgerline.pb.h"

/// The set of those who have a drone stopped, as contract, agent and ground keep it. Each identity has one stop at
/// most; each lifts its own. Thread-safe as the messages are.
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

/// The motors are to be off, since one of the stoppers says so.
inline bool is_cut(const Control& control) {
  return std::any_of(control.stoppers().begin(), control.stoppers().end(), [](const Stop& s) { return s.cut(); });
}

/// Takes one stopper's stop away; says whether there was one.
inline bool remove_stop(Control& control, const Identity& stopper) {
  return remove_entry(*control.mutable_stoppers(), stopper, whose_stop);
}

/// Adds a stop; of the same stopper, the newer word replaces the older one. A lifted one is no stop.
inline void add_stop(Control& control, const Stop& stop) {
  if (stop.lifted()) {
    remove_stop(control, stop.stopper());
  } else {
    put_entry(*control.mutable_stoppers(), stop, whose_stop);
  }
}

/// Lifts everybody's stop for a supervisor of the drone's organisation, else one's own. False: there was none.
inline bool lift_stops(Control& control, const Identity& who, bool supervisor) {
  if (!supervisor || control.owner().msp_id() != who.msp_id()) return remove_stop(control, who);
  control.clear_stoppers();
  return true;
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
