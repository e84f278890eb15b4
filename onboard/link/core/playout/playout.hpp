#pragma once
#include <array>
#include <cstdint>

#include "onboard/link/core/fixed_vector.hpp"
#include "onboard/link/core/settings.hpp"

namespace ledgerline::link {

/// A velocity of the map frame and a yaw rate, counter-clockwise.
struct Velocity {
  std::array<float, 3> mps{};
  float yaw_radps = 0;
};

/// What became of the plans. Once nothing is pending: received = applied + late + dropped.
struct PlanCounters {
  std::uint32_t received = 0;
  std::uint32_t applied = 0;  ///< at least one setpoint flown (or the wish of a take-off, landing or stop met)
  std::uint32_t late = 0;     ///< came, or could be flown, only after its last setpoint was over
  std::uint32_t dropped = 0;
  std::array<std::uint32_t, 7> dropped_by{};  ///< by DropReason
};

/// A plan that ended, for the trace.
struct PlanEnd {
  std::uint64_t sequence = 0;
  TimeNs state_stamp_ns = 0;
  DropReason reason = DropReason::none;  ///< none: late
};

/// How late plans come, and how much later than they say their setpoints are to be flown for it, as an audio jitter
/// buffer does: a quantile of the lateness of the newest 256 plans, never negative. The margin moves to it slowly, so
/// that the time of playout never goes back: it rises by half a second a second, falls by a twentieth.
class Margin {
 public:
  explicit Margin(const PlayoutSettings& settings) noexcept : settings_(settings) {}
  /// A plan came, this long after the time of its first setpoint (negative: before it).
  void add(TimeNs now, TimeNs lateness_ns) noexcept;
  /// Moves on to `now`.
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
/// successor leaves no gap. A plan once flown is never followed by an older one. When the newest plan is over, the wish
/// is zero, and the limiter ramps down to it. Core: no allocation; one thread.
class Playout {
 public:
  explicit Playout(const PlayoutSettings& settings) noexcept : settings_(settings), margin_(settings) {}

  /// The order check of every plan, whatever its action: counts it as received; anything but `none` means it was
  /// dropped.
  DropReason admit(TimeNs now, const Plan& plan) noexcept;
  /// Takes an admitted FLY plan; it may turn out late at once.
  void add(TimeNs now, const Plan& plan) noexcept;
  /// For admitted plans that never wait: take-off, land, stop.
  void count_applied() noexcept { ++counters_.applied; }
  void count_dropped(const Plan& plan, DropReason reason) noexcept;

  /// What the plans want at `now`, before limits.
  struct Wish {
    bool valid = false;  ///< a plan covers this moment
    bool fresh = false;  ///< its setpoint has not been sent yet
    Velocity velocity;
    std::uint64_t sequence = 0;
    TimeNs state_stamp_ns = 0;
    TimeNs meant_ns = 0;  ///< when the setpoint was meant to be flown; it is by the margin later
  };
  Wish wish(TimeNs now) noexcept;

  /// The wish's setpoint went to the drone. True when it was the plan's first: the plan is applied now.
  bool mark_sent() noexcept;

  /// No plan is to be flown any more (landing, or the end): the waiting ones are dropped with this reason.
  void clear(DropReason reason) noexcept;

  /// How much later than they say setpoints are flown now.
  TimeNs margin_ns() const noexcept { return margin_.value(); }
  /// When the newest plan ended or will end; 0: there was none.
  TimeNs covered_until_ns() const noexcept { return covered_until_ns_; }
  const PlanCounters& counters() const noexcept { return counters_; }

  /// Plans that ended unflown since the last call of clear_ends().
  const FixedVector<PlanEnd, 64>& ends() const noexcept { return ends_; }
  void clear_ends() noexcept { ends_.clear(); }

 private:
  struct Waiting {
    Plan plan;
    TimeNs end_ns = 0;
    bool applied = false;
    std::int32_t sent_setpoint = -1;
  };
  void finish(const Waiting& waiting, DropReason reason) noexcept;
  DropReason check(TimeNs now, const Plan& plan) const noexcept;
  TimeNs end_of(const Plan& plan) const noexcept;

  PlayoutSettings settings_;
  Margin margin_;
  FixedVector<Waiting, 64> waiting_;  ///< in order; the first is the one being flown, if it is due
  std::uint64_t newest_epoch_ = 0;
  std::uint64_t newest_sequence_ = 0;
  bool any_ = false;
  std::int32_t wished_setpoint_ = -1;  ///< of waiting_[0]
  TimeNs covered_until_ns_ = 0;
  PlanCounters counters_;
  FixedVector<PlanEnd, 64> ends_;
};

/// Keeps a velocity within speed and acceleration limits: each call moves the output toward the wish, no faster than
/// allowed.
class Limiter {
 public:
  explicit Limiter(const PlayoutSettings& settings) noexcept : settings_(settings) {}
  /// `braking` doubles the acceleration allowed: for failsafe brakes only.
  const Velocity& step(TimeNs now, const Velocity& wish, bool braking) noexcept;
  const Velocity& output() const noexcept { return output_; }
  /// The drone is known to stand still (on the ground, or right after take-off).
  void reset(TimeNs now) noexcept;

 private:
  PlayoutSettings settings_;
  Velocity output_;
  TimeNs last_ns_ = 0;
};

}  // namespace ledgerline::link
