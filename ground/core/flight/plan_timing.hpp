#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/base/result.hpp"
#include "common/msg/onboard.hpp"
#include "ground/core/controller.hpp"
#include "ground/motion/delays.hpp"

namespace ledgerline::ground {

/// Which moments a plan is for, of each drone: by what its states say of when plans came, or, while they say nothing,
/// by how long our own commands take. What states say of a plan belongs to the moment when that plan was made, on the
/// drone's clock. Deterministic; one thread.
class PlanTiming {
 public:
  struct Timing {
    TimeNs delay_ns = motion::RoundTripEstimate::unknown_ns;  ///< from a plan's making to its first setpoint
    TimeNs farthest_ns = 0;                                   ///< no setpoint of it may be for later than that
    std::size_t steps = PathController::steps;
  };

  explicit PlanTiming(std::size_t drones) : drones_(drones) {}

  /// A plan of the drone went out; of a number that is used again, what is made newest counts.
  void submitted(std::size_t drone, std::uint64_t sequence, TimeNs made_ns);
  /// Every state counts, not the newest of a burst alone.
  void observe(std::size_t drone, const StateSample& state);
  /// One of our calls was seen in a block, so long after its submission.
  void measure(TimeNs one_way_ns);
  /// What came under the lease before says nothing any more.
  void begin_lease(std::size_t drone);

  const Timing& of(std::size_t drone) const;
  /// The error says why no plan could be flown in time, as far as our own calls show: the ledger is too slow.
  Status check_delay() const;
  /// The maximum over all drones.
  TimeNs max_delay_ns() const;

 private:
  static constexpr TimeNs max_plan_delay_ns = 4 * ns_per_s;
  static constexpr TimeNs overdue_ns =
      2 * ns_per_s;  ///< a plan that agent may have refused because it was for too late
  static constexpr TimeNs state_every_ns = 5 * ns_per_ms;  ///< at most; a plan each
  struct PlanRecord {
    std::uint64_t sequence = 0;
    TimeNs made_ns = 0;
  };
  struct Drone {
    motion::Window arrivals;                           ///< from a plan's making until it was there; the drone's clock
    motion::Window spacings;                           ///< between two plans that came
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
  static void take_arrival(Drone& drone, TimeNs arrived_ns, TimeNs took_ns);
  static void forget_arrivals(Drone& drone);

  std::vector<Drone> drones_;
  motion::RoundTripEstimate two_way_;
  Timing guess_;  ///< by two_way_, for drones of which no plan is known to have come lately
};

}  // namespace ledgerline::ground
