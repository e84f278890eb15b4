#pragma once
#include <algorithm>

#include "common/rt/clock.hpp"

namespace ledgerline::deployment {

/// What agent's and ground's configs say of time, for a ledger that cuts its blocks late.
struct Timeouts {
  // The programs' defaults, for a ledger that answers at once.
  TimeNs max_age_ns = 500 * ns_per_ms;  ///< agent's [check] max_age_ms
  TimeNs silent_after_ns = ns_per_s;    ///< agent's [agent] ledger_silent_after_ms
  TimeNs deadline_ns = ns_per_s;        ///< [ledger] deadline_ms of both
};

/// `longer_ns`: by how much a command may be older (fabric::both_ways_ns), and a quiet ledger is not yet a silent one.
/// `max_age_ns` that somebody asked for counts more; 0: none.
inline Timeouts timeout_with(TimeNs longer_ns, TimeNs max_age_ns = 0) {
  const Timeouts usual;
  return {.max_age_ns = max_age_ns > 0 ? max_age_ns : usual.max_age_ns + longer_ns,
          .silent_after_ns = usual.silent_after_ns + std::max(longer_ns, max_age_ns),
          .deadline_ns = usual.deadline_ns + longer_ns};
}

}  // namespace ledgerline::deployment
