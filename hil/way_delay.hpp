#pragma once
#include <array>
#include <string>

#include "common/rt/clock.hpp"
#include "common/rt/random.hpp"
#include "common/rt/result.hpp"
#include "hil/distribution.hpp"

namespace ledgerline::hil {

/// A published two-way latency (ground/report/published.hpp) as a distribution, seconds: straight between its whiskers,
/// quartiles and median. A box says nothing of what lies beyond its whiskers: here 4 of 100, up to 0.5 s more.
struct PublishedDelay {
  std::string_view name;  ///< of the option
  double low, q1, median, q3, high;
  static constexpr double beyond_whisker = 0.04, longest_beyond_s = 0.5;
  /// 0 <= share <= 1.
  double quantile(double share) const;
};
inline constexpr std::array published_delays{
    PublishedDelay{"published", 0.313, 0.396, 0.456, 0.525, 0.711},
    PublishedDelay{"published-triangle", 0.295, 0.387, 0.458, 0.512, 0.697},
    PublishedDelay{"published-x", 0.316, 0.439, 0.521, 0.618, 0.879},
    PublishedDelay{"published-three", 0.529, 0.731, 0.802, 0.873, 1.081},
};

/// What is added to a ledger's own delay between a state and its command, both ways together.
struct AddedDelay {
  enum class Kind { none, constant, published, recorded };
  Kind kind = Kind::none;
  double constant_s = 0;                                   ///< of a constant one
  const PublishedDelay* published = &published_delays[0];  ///< of a published one; the ledger's own is within it
  Distribution recorded{};                                 ///< of a recorded one
};
/// "none", seconds from 0 to 3, a name of published_delays, or a file of such seconds, one a line.
Result<AddedDelay> added_delay_from(const std::string& text, const ReadFile& read = read_file);

/// One of the two ways of an AddedDelay: half of it. Drawn anew every 100 ms, so what is sent meanwhile stays together;
/// a recording is played in its order, from a place that the seed chooses. The way back has what the newest that came
/// there had: with the same seed, both ways of a state and its command together are one draw of the whole delay.
/// Deterministic for a seed; one thread.
class WayDelay {
 public:
  enum class Way { there, back };
  WayDelay(const AddedDelay& delay, Way way, std::uint64_t seed)
      : delay_(delay), way_(way), random_(seed), recording_(seed) {}
  /// Times must not go back.
  TimeNs at(TimeNs now);

 private:
  TimeNs draw();

  static constexpr std::uint64_t kept = 32;  ///< draws: more than the longest way takes
  AddedDelay delay_;
  Way way_;
  Random random_;
  Draws recording_;
  std::array<TimeNs, kept> halves_{};
  std::uint64_t drawn_ = 0;
};

}  // namespace ledgerline::hil
