#pragma once
#include "common/rt/clock.hpp"

namespace ledgerline::link {
inline constexpr TimeNs ms = ns_per_ms;
}
