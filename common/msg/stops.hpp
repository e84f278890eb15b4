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

inline bool is_stopped(const Control& control) { return !control.stoppers().empty(); }

/// The motors are to be off, since one of the stoppers says so.
inline bool is_cut(const Control& control) {
  return std::any_of(control.stoppers().begin(), control.stoppers().end(), [](const Stop& s) { return s.cut(); });
}

/// Takes one stopper's stop away; says whether there was one.
inline bool remove_stop(Control& control, const Identity& stopper) {
  auto& all = *control.mutable_stoppers();
  const auto rest =
      std::remove_if(all.begin(), all.end(), [&](const Stop& stop) { return same_identity(stop.stopper(), stopper); });
  const bool found = rest != all.end();
  all.erase(rest, all.end());
  return found;
}

/// Adds a stop; of the same stopper, the newer word replaces the older one. A lifted one is no stop.
inline void add_stop(Control& control, const Stop& stop) {
  remove_stop(control, stop.stopper());
  if (stop.lifted()) return;
  *control.add_stoppers() = stop;
  const auto order = [](const Stop& s) { return std::tie(s.stopper().msp_id(), s.stopper().subject()); };
  std::sort(control.mutable_stoppers()->begin(), control.mutable_stoppers()->end(),
            [&](const Stop& a, const Stop& b) { return order(a) < order(b); });
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
