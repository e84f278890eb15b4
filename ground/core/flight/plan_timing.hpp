#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/base/result.hpp"
#include "common/msg/onboard.hpp"
#include "ground/core/controller.hpp"

namespace ledgerline::ground {

/// The newest `kept` samples of a time, oldest overwritten; bounded; one thread.
class Window {
 public:
  static constexpr std::size_t kept = 64;
  void add(TimeNs t_ns);
  std::size_t size() const { return count_ < kept ? count_ : kept; }
  /// In no order, the first size() of it.
  const std::array<TimeNs, kept>& samples() const { return samples_; }
  /// 0 <= q <= 1; nothing while there is no sample.
  std::optional<TimeNs> quantile(double q) const;

 private:
  std::array<TimeNs, kept> samples_{};
  std::size_t count_ = 0;
};

/// How long a state's way and its command's way take together, as a distribution, without comparing clocks: on the
/// ground's clock alone, from what our own commands take from submission until their block is back here. That is one
/// command's way to the ledger and one way from the ledger, as a state's is; so the sum of two such samples has the
/// distribution of a state's and a command's ways together, where the drone's side is as far as ours. What states say
/// of plans that came is better: this is for as long as they say nothing. Deterministic; one thread.
class RoundTripEstimate {
 public:
  static constexpr TimeNs unknown_ns = 25 * ns_per_ms;  ///< while nothing was measured
  void add(TimeNs submission_to_block_ns);
  /// Of both ways together, over all pairs of samples.
  TimeNs quantile(double q) const;
  /// Of our own alone: wherever the drone's side is, it takes as long as this.
  TimeNs own(double q) const { return ways_.quantile(q).value_or(0); }

 private:
  Window ways_;
};

/// Which moments a plan is for, of each drone: by what its states say of when plans came, or, while they say nothing,
/// by how long our own commands take. What states say of a plan belongs to the moment when that plan was made, on the
/// drone's clock. Deterministic; one thread.
class PlanTiming {
 public:
  struct Timing {
    TimeNs delay_ns = RoundTripEstimate::unknown_ns;  ///< from a plan's making to its first setpoint
    TimeNs farthest_ns = 0;                           ///< no setpoint of it may be for later than that
    std::size_t steps = PathController::steps;
  };

  explicit PlanTiming(std::size_t drones) : drones_(drones) {}

  /// A plan of the drone went out. If a sequence number is reused, the newest plan counts.
  void submitted(std::size_t drone, std::uint64_t sequence, TimeNs made_ns);
  /// Every state counts, not the newest of a burst alone.
  void observe(std::size_t drone, const StateSample& state);
  /// One of our calls was seen in a block, so long after its submission.
  void measure(TimeNs one_way_ns);
  /// Forgets the plans and arrivals of the previous lease.
  void begin_lease(std::size_t drone);

  const Timing& of(std::size_t drone) const;
  /// The error says why no plan could be flown in time, as far as our own calls show: the ledger is too slow.
  Status check_delay() const;
  /// The maximum over all drones.
  TimeNs max_delay_ns() const;

 private:
  static constexpr TimeNs max_plan_delay_ns = 4 * ns_per_s;
  static constexpr TimeNs overdue_ns = 2 * ns_per_s;       ///< a plan that agent may have refused as too late
  static constexpr TimeNs state_every_ns = 5 * ns_per_ms;  ///< at most; a plan each
  struct PlanRecord {
    std::uint64_t sequence = 0;
    TimeNs made_ns = 0;
  };
  struct Drone {
    Window arrivals;                                   ///< from a plan's making until it was there; the drone's clock
    Window spacings;                                   ///< between two plans that came
    TimeNs first_arrival_ns = 0, last_arrival_ns = 0;  ///< of those; 0: none
    std::optional<Timing> timing;                      ///< by arrivals
    /// Of the newest plans submitted, as far back as one may be on its way.
    std::array<PlanRecord, (max_plan_delay_ns + overdue_ns) / state_every_ns + 1> plans{};
    std::uint64_t arrived_sequence = 0;  ///< as the newest state had it
  };
  /// How long plans take, as a distribution, and how far apart they come.
  struct Ways {
    TimeNs soonest_ns = 0, in_time_ns = 0, tail_ns = 0, spacing_ns = 0;
  };
  static Timing timing_for(const Ways& ways);
  const Timing& guess() const;
  static void add_arrival(Drone& drone, TimeNs arrived_ns, TimeNs took_ns);
  static void forget_arrivals(Drone& drone);

  std::vector<Drone> drones_;
  RoundTripEstimate two_way_;
  /// By two_way_, for drones of which no plan is known to have come lately; made when it is asked for.
  mutable std::optional<Timing> guess_ = Timing{};
};

}  // namespace ledgerline::ground
