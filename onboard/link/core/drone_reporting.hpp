#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <utility>

#include "common/base/check.hpp"
#include "common/msg/onboard.hpp"
#include "common/rt/histogram.hpp"
#include "onboard/link/core/failsafe.hpp"
#include "onboard/link/core/link_io.hpp"
#include "onboard/link/core/playout/playout.hpp"
#include "onboard/link/core/tello/session.hpp"

namespace ledgerline::link {

/// The transitions of one drone that are not on the ledger yet. Each heartbeat of agent says how far it has taken them
/// and how far they are on the ledger: what it has not taken is sent again, what is on the ledger is forgotten. So no
/// lost message, dead agent or absent ledger loses one. When `capacity` are kept the oldest goes, and counts as lost
/// unless agent has it; a reader of the ledger sees the gap in the numbers. No allocation; one thread.
class TransitionLog {
 public:
  static constexpr std::uint64_t capacity = 256;

  struct Counters {
    std::uint64_t made = 0, on_ledger = 0, lost = 0, kept = 0;
  };

  void add(Transition transition) noexcept {
    if (newest_ + 1 - oldest_ == capacity) {
      if (oldest_ > taken_) ++lost_;
      ++oldest_;
    }
    transition.number = ++newest_;
    LEDGERLINE_CHECK(newest_ - oldest_ < capacity, "the transitions that are kept have room", oldest_, newest_);
    kept_[newest_ % capacity] = transition;
  }

  /// What a heartbeat of agent says of this drone; zeros when it knows another boot, or none.
  void acknowledge(std::uint64_t taken, std::uint64_t on_ledger) noexcept {
    on_ledger_ = std::max(on_ledger_, std::min(on_ledger, newest_));
    oldest_ = std::max(oldest_, on_ledger_ + 1);
    taken_ = std::clamp(taken, on_ledger_, newest_);
    sent_ = taken_;
  }

  /// The next that agent should take; false: it was sent everything.
  bool next(Transition& out) noexcept {
    sent_ = std::max(sent_, oldest_ - 1);
    if (sent_ == newest_) return false;
    out = kept_[++sent_ % capacity];
    out.oldest = oldest_;
    out.lost = lost_;
    return true;
  }

  Counters counters() const noexcept { return {newest_, on_ledger_, lost_, newest_ + 1 - oldest_}; }

 private:
  std::array<Transition, capacity> kept_{};  ///< number n is at n % capacity
  std::uint64_t oldest_ = 1, newest_ = 0;    ///< kept: from the one to the other
  std::uint64_t sent_ = 0;
  std::uint64_t taken_ = 0, on_ledger_ = 0;  ///< by agent; on the ledger
  std::uint64_t lost_ = 0;
};

/// Figures of one drone since the start.
struct DroneReport {
  std::string name;
  DroneNumber number = 0;
  std::uint64_t states_sampled = 0;
  PlanCounters plans;
  TransitionLog::Counters transitions;
  Quantiles age_ms;     ///< at application: sent - the state's stamp
  bool heard = false;   ///< anything at all came from it
  bool landed = false;  ///< it flew and is on the ground again
  LinkPhase phase = LinkPhase::disconnected;
};

/// What others get to know of one drone: its transitions until they are on the ledger, its samples, what its trace
/// says, its figures. Decides nothing. Core: no I/O, no clock, no allocation after construction; one thread.
class DroneReporting {
 public:
  DroneReporting(std::string name, DroneNumber number, std::uint64_t boot_id)
      : name_(std::move(name)), number_(number), boot_id_(boot_id) {}

  void on_heartbeat(const AgentHeartbeat& heartbeat) noexcept;
  void record_received(const LinkMoment& at, const Plan& plan, TimeNs margin_ns) noexcept;
  void record_arrival(TimeNs now, const Plan& plan) noexcept { arrived_ = {plan.sequence, now}; }
  /// A command took effect, `late_ns` behind the moment it was meant for, while this was sent.
  void record_applied(const LinkMoment& at, const Plan& plan, const Velocity& sent) noexcept {
    trace_applied(at, plan.sequence, plan.state_stamp_ns, 0, sent);
  }
  /// A setpoint was sent. `first`: of its plan.
  void record_setpoint(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint, bool first,
                       const Velocity& sent) noexcept;
  /// Plans that ended unflown since the last call.
  void record_ends(const LinkMoment& at, PlanAdmission& admission) noexcept;
  void record_mode(const LinkMoment& at, LinkPhase phase, const FailsafeState& failsafe) noexcept;
  /// Once a step: logs what changed, and sends what agent should take next.
  void record_transition(const LinkMoment& at, LinkPhase phase, const FailsafeState& failsafe) noexcept;
  void record_serial(const LinkMoment& at, const SerialCheck& serial) noexcept;
  /// What it said that people are to read, once each.
  void record_words(const LinkMoment& at, const TelloSession& session) noexcept;
  /// Completes a sample by what is kept here, and publishes it.
  void publish(const LinkMoment& at, StateSample sample) noexcept;

  DroneReport report(const TelloSession& session, const PlanCounters& plans) const;

 private:
  void trace(const LinkMoment& at, TraceRecord record) const noexcept;
  void trace_applied(const LinkMoment& at, std::uint64_t sequence, TimeNs state_stamp_ns, TimeNs late_ns,
                     const Velocity& sent) noexcept;

  std::string name_;
  DroneNumber number_;
  std::uint64_t boot_id_;
  TransitionLog transitions_;
  Transition last_transition_;
  struct {
    LinkPhase phase = LinkPhase::disconnected;
    FailsafeMode mode = FailsafeMode::none;
    FailsafeCause cause = FailsafeCause::none;
  } traced_;  ///< newest in the trace
  SerialCheck::Verdict reported_serial_ = SerialCheck::Verdict::unwanted;
  TimeNs reported_refusal_ns_ = 0, reported_unreadable_ns_ = 0;
  std::uint64_t states_sampled_ = 0;
  std::uint64_t applied_sequence_ = 0;  ///< of the plan whose setpoint was sent last
  struct {
    std::uint64_t sequence = 0;
    TimeNs at_ns = 0;
  } arrived_;  ///< newest plan
  Histogram age_;
};

}  // namespace ledgerline::link
