#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "common/base/enum_count.hpp"
#include "common/rt/fixed_vector.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

constexpr std::string_view name(DropReason reason) noexcept { return enum_name(reason); }

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

/// Of agent, when a lease has ended: its holder's plans are not flown to their end. It begins the next epoch.
inline bool is_empty_plan(const Plan& plan) noexcept {
  return plan.action == PlanAction::fly && plan.count == 0 && plan.sequence == 0;
}

/// Whether a drone's plan may be acted on, whatever its action, and what became of each. A plan never goes behind a
/// newer one: (epoch, sequence) only rises. What wants flight must be young and made of plausible numbers; a landing is
/// never too old, and what comes from the contract (stop, cut, stop_cleared) carries no sequence and is always
/// admitted. Who acts on it reports here how it ended. Core: no allocation; one thread.
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

/// How much later than they say setpoints are to be flown because plans come late, as an audio jitter buffer does: a
/// quantile of the lateness of the newest 256 plans, never negative. The margin moves to it slowly, so that the time of
/// playout never goes back: it rises by half a second a second, falls by a twentieth. Core: no allocation; one thread.
class Margin {
 public:
  explicit Margin(const PlayoutSettings& settings) noexcept : settings_(settings) {}
  /// A plan came, this long after the time of its first setpoint (negative: before it).
  void add(TimeNs now, TimeNs lateness_ns) noexcept;
  TimeNs step(TimeNs now) noexcept;
  TimeNs value() const noexcept { return margin_ns_; }

 private:
  PlayoutSettings settings_;
  std::array<TimeNs, 256> lateness_ns_{};
  std::size_t count_ = 0;  ///< plans so far
  TimeNs target_ns_ = 0;
  TimeNs target_since_ns_ = 0;
  TimeNs margin_ns_ = 0;
  TimeNs last_ns_ = 0;
};

/// Flies each setpoint at the time it is meant for, or behind it by a margin where plans come late. Plans come in
/// bursts; a newer plan takes over when its first setpoint is due, until then the one before it is flown, so a late
/// successor leaves no gap. A plan once flown is never followed by an older one. When the newest plan is over, the
/// setpoint is zero, and the limiter ramps down to it. Core: no allocation; one thread.
class Playout {
 public:
  /// `admission`: gets how each plan ends; outlives this.
  Playout(const PlayoutSettings& settings, PlanAdmission& admission) noexcept
      : settings_(settings), admission_(admission), margin_(settings) {}

  /// Takes an admitted FLY plan; it may turn out late at once.
  void add(TimeNs now, const Plan& plan) noexcept;

  /// What the plans want at `now`, before limits.
  struct CurrentSetpoint {
    bool valid = false;  ///< a plan covers this moment
    bool fresh = false;  ///< its setpoint has not been sent yet
    Velocity velocity;
    bool body_frame = false;  ///< of that velocity: forward, left, up; else the map's
    bool has_reference = false;
    Reference reference{};  ///< moved on to `now`
    Response response{};    ///< of the drone, as its plan says
    std::uint64_t sequence = 0;
    TimeNs state_stamp_ns = 0;
    TimeNs meant_ns = 0;  ///< when the setpoint was meant to be flown; it is by the margin later
  };
  CurrentSetpoint setpoint(TimeNs now) noexcept;

  /// The setpoint went to the drone. True when it was the plan's first: the plan is applied now.
  bool mark_sent() noexcept;

  /// No plan is to be flown any more (landing, or the end): the waiting ones are dropped with this reason.
  void clear(DropReason reason) noexcept;

  /// How much later than they say setpoints are flown now.
  TimeNs margin_ns() const noexcept { return margin_.value(); }
  /// When the newest plan ended or will end; 0: there was none.
  TimeNs covered_until_ns() const noexcept { return covered_until_ns_; }

 private:
  struct Waiting {
    Plan plan;
    TimeNs end_ns = 0;
    bool applied = false;
    std::int32_t sent_setpoint = -1;
  };
  void finish(const Waiting& waiting, DropReason reason) noexcept;
  TimeNs end_of(const Plan& plan) const noexcept;

  PlayoutSettings settings_;
  PlanAdmission& admission_;
  Margin margin_;
  FixedVector<Waiting, 64> waiting_;  ///< in order; the first is the one being flown, if it is due
  std::int32_t desired_index_ = -1;   ///< of waiting_[0]
  TimeNs covered_until_ns_ = 0;
};

}  // namespace ledgerline::link
