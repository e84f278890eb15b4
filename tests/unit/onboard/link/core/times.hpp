#pragma once
#include "common/rt/clock.hpp"

namespace ledgerline::link {
inline constexpr TimeNs ms = ns_per_ms;
inline constexpr TimeNs between_texts_ns = 100 * ms;  ///< of state
}  // namespace ledgerline::link
