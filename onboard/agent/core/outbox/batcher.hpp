#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "common/fabric/calls/in_flight.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/onboard.hpp"
#include "common/rt/retry.hpp"
#include "onboard/agent/core/drone_name.hpp"

namespace ledgerline::agent {

struct BatchSettings {
  TimeNs min_gap_ns = 0;                  ///< between the starts of two batches, whatever is committed
  TimeNs linger_ns = 500 * ns_per_us;     ///< wait so long for the samples of the other drones of the same instant
  TimeNs freshness_ns = 500 * ns_per_ms;  ///< a sample that had to wait until it is older is not sent any more
  BackOffLimits back_off{};               ///< of the other calls of agent, too
  TimeNs refused_drone_pause_ns = 1 * ns_per_s;  ///< a drone that made a batch be refused stays out of batches so long
};

/// One `set` to be: the newest sample of each drone that has a new one. The caller encodes and submits it, and reports
/// its end.
struct StateBatch {
  std::uint64_t number = 0;
  TimeNs submitted_ns = 0;
  std::vector<StateSample> samples;
  /// The last samples of the drones without a new one, sent before and not counted again: the batch is stored under one
  /// key, so what it leaves out would be gone from `get`. Readers know them by their sequence.
  std::vector<StateSample> repeated;
  std::vector<DroneNumber> batteries;  ///< of these samples the charge is sent, too
};

/// Few transactions, many samples: one batch is in flight until it is committed; where that takes long, the next one
/// goes behind a gap (fabric::InFlight). What arrives meanwhile rides in the next one; of each drone only the
/// newest sample rides, older ones are merged; what waited past its freshness is dropped. How a batch ends:
///
///     committed               on_ledger, next batch at once (or after min_gap)
///     invalidated             dropped (a newer sample says more), next batch goes on
///     refused for one drone   that drone's sample is dropped and it pauses; the others are sent again at once, or
///                             their newer samples instead (then the old ones are merged)
///     refused, unavailable,   dropped, back-off with jitter: nothing goes out until it is over, samples merge
///       overloaded              meanwhile
///
/// A drone's charge is sent when it has changed or its last batch did not get there, and with every 16th of its states
/// for those who begin to read.
///
/// Always, for each drone: sampled = on_ledger + merged + dropped + pending. Memory is bounded by the number of drones.
/// One thread; the same inputs and seed give the same batches.
class Batcher {
 public:
  struct Counters {
    std::uint64_t sampled = 0, sent = 0, on_ledger = 0, merged = 0, dropped = 0;
    std::uint64_t pending = 0;  ///< waiting or in flight
    std::uint64_t stale = 0;    ///< of the dropped: waited past their freshness
  };
  struct Transactions {
    std::uint64_t committed = 0, invalidated = 0, refused = 0, unavailable = 0;
  };

  Batcher(const BatchSettings& settings, const std::vector<DroneName>& drones, std::uint64_t seed);

  /// A sample of a drone that is not ours is ignored; one that is not newer than the pending one of its boot is merged.
  void add(TimeNs now, const StateSample& sample);
  /// The batch to submit now, if any; it is then in flight.
  std::optional<StateBatch> next(TimeNs now);
  /// How batch `number` ended. Returns it; nothing if it is not in flight (then nothing changes).
  std::optional<StateBatch> finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome);

  /// When next() may have a batch if nothing else comes, so that nobody has to poll; INT64_MAX: not before something
  /// comes. As of `now`, which next() was called with last, and by which next() decides.
  TimeNs due_ns(TimeNs now) const;

  std::size_t calls_in_flight() const { return in_flight_.size(); }
  /// A sample waits, so next() may have a batch soon.
  bool has_waiting() const;
  Counters counters(DroneNumber drone) const;
  const Transactions& transactions() const { return transactions_; }
  /// Nothing goes out before this time.
  TimeNs back_off_until_ns() const { return pause_.until_ns(); }

 private:
  struct Slot {
    DroneName drone{};
    Counters counters{};
    std::optional<StateSample> waiting{};
    TimeNs newest_ns = INT64_MIN / 2;
    TimeNs paused_until_ns = INT64_MIN;
    std::optional<StateSample> sent{};  ///< newest submitted: sent again, it is not counted again
    float battery = 0;                  ///< the charge that was sent last
    TimeNs battery_ns = 0;              ///< when
    std::size_t states_to_battery = 0;  ///< states left until the battery is sent again
  };
  Slot* refused_drone(const StateBatch& batch, const fabric::Outcome& outcome);
  void drop_all(const StateBatch& batch);
  void drop_stale(TimeNs now);
  /// True when the charge goes out with this state.
  static bool take_battery_turn(TimeNs now, Slot& slot);
  void send_again_without(TimeNs now, Slot& refused, const StateBatch& batch);

  BatchSettings settings_;
  std::vector<Slot> slots_;
  Random random_;
  fabric::InFlight<StateBatch> in_flight_;
  BackOff pause_;
  Transactions transactions_;
  std::uint64_t last_number_ = 0;
  TimeNs first_waiting_ns_ = 0;
  bool again_at_once_ = false;
};

/// The batch as a call of `set` with stream = true: for each sample, repeated ones too, `<drone>/odom` and
/// `<drone>/link`, and `<drone>/battery` where it is due. `real_offset_ns`: real time minus the clock of the samples'
/// stamps, for the ROS headers.
fabric::Call encode_batch(const StateBatch& batch, const std::vector<DroneName>& drones, TimeNs real_offset_ns);

}  // namespace ledgerline::agent
