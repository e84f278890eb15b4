#pragma once
#include <cstdlib>
#include <string_view>

namespace ledgerline {

/// Sanitizers make each flight ten times as long and more: a few of them look into every corner.
#ifdef LEDGERLINE_SANITIZED
inline constexpr bool slow = true;
#else
inline constexpr bool slow = false;
#endif

/// How many seeds a campaign runs: the slice of every test run, or the whole with `./run-tests --long`.
inline int seeds(int slice, int whole) {
  const char* asked = std::getenv("LEDGERLINE_LONG");
  return asked && std::string_view(asked) == "1" ? whole : slice;
}

}  // namespace ledgerline
