#pragma once
#include "common/rt/clock.hpp"

namespace ledgerline {

/// `since` remembers from when `seen` has been true without a break; 0: it is not.
inline void update_since(TimeNs now, bool seen, TimeNs& since) noexcept {
  if (!seen) {
    since = 0;
  } else if (since == 0) {
    since = now;
  }
}

/// Whether `seen` was true for all of `long_enough`.
inline bool has_lasted(TimeNs now, bool seen, TimeNs& since, TimeNs long_enough) noexcept {
  update_since(now, seen, since);
  return seen && now - since >= long_enough;
}

}  // namespace ledgerline
