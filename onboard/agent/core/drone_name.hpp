#pragma once
#include <algorithm>
#include <string>
#include <type_traits>

#include "common/msg/onboard.hpp"

namespace ledgerline::agent {

/// A drone of this host: its number in shared memory and its name on the ledger.
struct DroneName {
  DroneNumber number = 0;
  std::string name;
};

/// The entry of one of our drones, by number or name, in a list whose entries have a `drone`; null: it is not ours.
template <typename Entries, typename Id>
auto* find_drone(Entries& entries, const Id& id) {
  const auto it = std::find_if(entries.begin(), entries.end(), [&](const auto& entry) {
    if constexpr (std::is_integral_v<Id>)
      return entry.drone.number == id;
    else
      return entry.drone.name == id;
  });
  return it == entries.end() ? nullptr : &*it;
}

}  // namespace ledgerline::agent
