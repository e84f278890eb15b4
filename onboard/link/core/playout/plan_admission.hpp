#pragma once
#include <array>
#include <cstdint>

#include "common/base/enum_count.hpp"
#include "onboard/link/core/fixed_vector.hpp"
#include "onboard/link/core/settings.hpp"

namespace ledgerline::link {

/// What became of the plans. Once nothing is pending: received = applied + late + dropped.
struct PlanCounters {
  std::uint32_t received = 0;
  std::uint32_t applied = 0;  ///< at least one setpoint flown, or its take-off, landing or stop begun
  std::uint32_t late = 0;     ///< came, or could be flown, only after its last setpoint was over
  std::uint32_t dropped = 0;
  std::array<std::uint32_t, enum_count<DropReason>> dropped_by{};  ///< by DropReason
};

/// A plan that ended unflown, for the trace.
struct PlanEnd {
  std::uint64_t sequence = 0;
  TimeNs state_stamp_ns = 0;
  DropReason reason = DropReason::none;  ///< none: late
};

/// Of agent itself, when a lease has ended: what its holder has planned is not flown to its end. It begins the next
/// lease's epoch, before the first plan under it.
inline bool is_empty_plan(const Plan& plan) noexcept {
  return plan.action == PlanAction::fly && plan.count == 0 && plan.sequence == 0;
}

/// Whether a drone's plan may be acted on, whatever its action, and what became of each. A plan never goes behind a
/// newer one: (epoch, sequence) only rises. What wants flight must be young and made of plausible numbers; a landing
/// is never too old, and what comes from the contract (stop, cut, stop_cleared) carries no sequence and is always
/// admitted. The caller that acts on an admitted plan reports here how it ended: applied, late or dropped. Core: no
/// allocation; one thread.
class PlanAdmission {
 public:
  explicit PlanAdmission(const PlayoutSettings& settings) noexcept : settings_(settings) {}

  /// Counts it as received. Anything but `none` means that it was dropped.
  DropReason admit(TimeNs now, const Plan& plan) noexcept;

  void record_applied() noexcept { ++counters_.applied; }
  /// It ended unflown; none: it is late.
  void record_end(const Plan& plan, DropReason reason) noexcept;

  const PlanCounters& counters() const noexcept { return counters_; }
  /// Plans that ended unflown since the last call of clear_ends().
  const FixedVector<PlanEnd, 64>& ends() const noexcept { return ends_; }
  void clear_ends() noexcept { ends_.clear(); }

 private:
  DropReason check(TimeNs now, const Plan& plan) const noexcept;

  PlayoutSettings settings_;
  std::uint64_t newest_epoch_ = 0;
  std::uint64_t newest_sequence_ = 0;
  bool any_ = false;
  PlanCounters counters_;
  FixedVector<PlanEnd, 64> ends_;
};

}  // namespace ledgerline::link
