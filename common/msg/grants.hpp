#pragma once
#include <algorithm>
#include <cstdint>
#include <string>
#include <tuple>

#include "common/msg/contract.hpp"
#include "common/msg/stops.hpp"
#include "ledgerline.pb.h"

/// What a drone's organisation lets others do with it, as the contract decides and as agent and ground judge its events.
/// Thread-safe as the messages are.
namespace ledgerline {

/// What an operator or supervisor may do with a drone.
struct Rights {
  bool fly = false, stop = false, cut = false;
  std::uint32_t max_priority = 0;  ///< of an acquire
};

/// Within the drone's organisation everything, elsewhere what is granted to the identity or to its organisation.
template <typename List>
Rights rights_of(const List& grants, const std::string& owner_msp_id, const Identity& who) {
  if (who.msp_id() == owner_msp_id) return {true, true, true, contract::max_priority};
  Rights rights;
  for (const Grant& grant : grants) {
    const Identity& to = grant.to();
    if (to.msp_id() != who.msp_id() || (!to.subject().empty() && to.subject() != who.subject())) continue;
    rights.fly |= grant.fly();
    rights.stop |= grant.stop() || grant.fly() || grant.cut();
    rights.cut |= grant.cut();
    if (grant.fly()) rights.max_priority = std::max(rights.max_priority, grant.max_priority());
  }
  return rights;
}
inline Rights rights_of(const Control& control, const Identity& who) {
  return rights_of(control.grants(), control.owner().msp_id(), who);
}

/// Ends a lease; the epoch is the new one.
inline void end_lease(Control& control, std::uint64_t epoch) {
  control.clear_holder();
  control.set_priority(0);
  control.set_epoch(epoch);
}

/// Puts a grant in place of what its identity or organisation had. A lease that is no longer granted ends, under the new
/// epoch; a priority that is no longer granted is lowered.
inline void set_grant(Control& control, const Grant& grant, std::uint64_t new_epoch) {
  auto& all = *control.mutable_grants();
  all.erase(std::remove_if(all.begin(), all.end(), [&](const Grant& g) { return same_identity(g.to(), grant.to()); }),
            all.end());
  if (grant.fly() || grant.stop() || grant.cut()) *control.add_grants() = grant;
  const auto order = [](const Grant& g) { return std::tie(g.to().msp_id(), g.to().subject()); };
  std::sort(all.begin(), all.end(), [&](const Grant& a, const Grant& b) { return order(a) < order(b); });
  if (!control.has_holder()) return;
  const Rights rights = rights_of(control, control.holder());
  if (!rights.fly) return end_lease(control, new_epoch);
  control.set_priority(std::min(control.priority(), rights.max_priority));
}

}  // namespace ledgerline
