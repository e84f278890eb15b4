#pragma once
#include <array>
#include <cstddef>
#include <optional>

#include "common/rt/clock.hpp"

namespace ledgerline::motion {

/// The newest `kept` samples of a time, oldest overwritten; Bounded; one thread.
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

}  // namespace ledgerline::motion
