#pragma once
#include <array>
#include <optional>
#include <string>

#include "common/base/random.hpp"
#include "common/base/result.hpp"
#include "common/rt/clock.hpp"
#include "hil/netem/distribution.hpp"

namespace ledgerline::hil {

/// Two-way delays that are injected so that what is measured has a published box (tools/report/published.hpp), with a
/// few of 100 beyond its upper whisker: quantiles, seconds, straight in between. They are not the box itself, since
/// blocks keep their order: what is slow holds up what follows, and the newest of those that come together is answered.
/// Found by flying; a test compares boxes.
struct PublishedDelay {
  static constexpr std::array shares{0.0, 0.25, 0.5, 0.75, 0.96, 1.0};
  std::string_view name;  ///< of the option
  std::array<double, shares.size()> quantiles_s;
  /// 0 <= share < 1.
  double quantile(double share) const;
};
inline constexpr std::array published_delays{
    PublishedDelay{"published", {0.277, 0.360, 0.435, 0.500, 0.756, 1.911}},
    PublishedDelay{"published-triangle", {0.262, 0.346, 0.442, 0.483, 0.743, 1.895}},
    PublishedDelay{"published-x", {0.252, 0.384, 0.488, 0.592, 1.003, 2.151}},
    PublishedDelay{"published-three", {0.354, 0.714, 0.778, 0.836, 1.110, 2.242}},
};

/// What is added to a ledger's own delay between a state and its command, both ways together.
struct AddedDelay {
  const PublishedDelay* published = nullptr;
  std::optional<Distribution> own{};  ///< where it is no published one
  double agent_share = 0.5;           ///< of it that lies between agent and ledger; the rest: between ground and ledger
  bool none() const { return !published && !own; }
};
/// "none", seconds from 0 to 3, a name of published_delays, or a file of such seconds, one a line.
Result<AddedDelay> added_delay_from(const std::string& text, const ReadRecording& read = read_recording);

/// One of the two ways of an AddedDelay: its share, and the other one has the rest. Drawn again every 100 ms, so what
/// is sent meanwhile stays together; a recording is played in its order, from a place that the seed chooses. The way
/// back has what the newest that came there had: with the same seed, both ways of a state and its command together are
/// one draw of the whole delay. Deterministic for a seed; one thread.
class WayDelay {
 public:
  enum class Way { there, back };
  WayDelay(const AddedDelay& delay, Way way, double share, std::uint64_t seed)
      : delay_(delay), way_(way), share_(share), random_(seed), draws_of_own_(seed) {}
  /// Times must not go back.
  TimeNs at(TimeNs now);

 private:
  TimeNs draw();

  static constexpr std::uint64_t kept = 32;  ///< draws: more than the maximum delay spans
  AddedDelay delay_;
  Way way_;
  double share_;
  Random random_;
  Draws draws_of_own_;
  std::array<TimeNs, kept> draws_{};
  std::uint64_t drawn_ = 0;
};

}  // namespace ledgerline::hil
