#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/fabric/sending/outcome.hpp"

namespace ledgerline::ground::service {

/// Calls that did not get through, said at most once a second for each drone and kind of end, with how many there were:
/// a storm of them must not push other events out of sight. Deterministic; one thread.
class Refusals {
 public:
  /// `names`: of the drones; a refusal of any other name is of none of them.
  explicit Refusals(std::vector<std::string> names) : names_(std::move(names)) {}

  struct RefusalNotice {
    std::string drone;  ///< empty: of none
    std::string text;
  };
  /// How a call of `function` ended; a committed one is nothing to say.
  void take(std::string_view function, const fabric::Outcome& outcome);
  /// What is due.
  std::vector<RefusalNotice> due(TimeNs now);

 private:
  struct Slot {
    std::string text;         ///< of the newest
    std::uint64_t count = 0;  ///< not said yet
    TimeNs next_ns = 0;
  };
  const std::vector<std::string> names_;
  std::map<std::pair<std::string, fabric::Outcome::Kind>, Slot> slots_;  ///< by drone
};

}  // namespace ledgerline::ground::service
