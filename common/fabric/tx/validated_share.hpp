#pragma once
#include <cstdint>
#include <optional>

#include "common/fabric/tx/transaction.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::fabric {

/// How many transactions were validated, and how many count by the peer's flag alone, since they rest on what nobody
/// here has seen. At a start those are many, and soon few. When they grow again, a start does not explain it: somebody
/// may have pushed out what was known. Deterministic; one thread.
class ValidatedShare {
 public:
  void add(TimeNs now, const Block& block);
  std::uint64_t validated() const { return validated_; }
  std::uint64_t by_flag() const { return by_flag_; }

  struct Rise {
    std::uint64_t by_flag = 0, of = 0;  ///< transactions of window_ns
  };
  /// Once for each time that more than half go by the flag, after it were fewer than a quarter.
  std::optional<Rise> take_rise();

  static constexpr TimeNs window_ns = 10 * ns_per_s;
  static constexpr std::uint64_t fewest = 20;  ///< in a window: of fewer the share says nothing

 private:
  std::uint64_t validated_ = 0, by_flag_ = 0;
  TimeNs begun_ns_ = 0;  ///< the window
  Rise now_{};
  bool low_ = false;  ///< in the newest window that says something
  std::optional<Rise> rise_;
};

}  // namespace ledgerline::fabric
