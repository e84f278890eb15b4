#pragma once
#include <algorithm>
#include <cstdint>

#include "common/msg/grants.hpp"
#include "common/msg/stops.hpp"
#include "ledgerline.pb.h"

/// Those who ask a drone's holder for the lease, as contract, agent and ground keep them. Each identity asks once; a
/// newer request replaces its older one. Thread-safe as the messages are.
namespace ledgerline {

inline const Identity& whose_request(const Request& request) { return request.who(); }

/// nullptr: it asks for nothing.
inline const Request* request_of(const Control& control, const Identity& who) {
  const auto& all = control.requests();
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const Request& one) { return same_identity(one.who(), who); });
  return found == all.end() ? nullptr : &*found;
}

/// False: there was none.
inline bool remove_request(Control& control, const Identity& who) {
  return remove_entry(*control.mutable_requests(), who, whose_request);
}

/// `delegate`: of the lease that is asked for; null: none.
inline void add_request(Control& control, const Identity& who, const Identity* delegate, std::uint32_t priority) {
  Request one;
  *one.mutable_who() = who;
  if (delegate != nullptr) *one.mutable_delegate() = *delegate;
  one.set_priority(priority);
  put_entry(*control.mutable_requests(), one, whose_request);
}

/// Gives the lease to one who has requested it, with the delegate and at the priority requested, as far as that is
/// granted to him. False: he has not requested it, or he may not fly it any more, or his delegate is revoked.
inline bool hand_over_lease(Control& control, const Identity& to, std::uint64_t new_epoch) {
  const Request* request = request_of(control, to);
  const Rights rights = rights_of(control, to);
  if (!request || !rights.fly) return false;
  const Identity* delegate = delegate_in(*request);
  if (delegate != nullptr && is_revoked(control, *delegate)) return false;
  begin_lease(control, to, delegate, new_epoch, std::min(request->priority(), rights.max_priority));
  remove_request(control, to);
  return true;
}

}  // namespace ledgerline
