#pragma once
#include <string>

#include "common/rt/clock.hpp"
#include "common/rt/random.hpp"
#include "common/rt/result.hpp"

namespace ledgerline::hil {

/// What is added to a ledger's own delay between a state and its command, both ways together.
struct AddedDelay {
  enum class Kind { none, constant, published };
  Kind kind = Kind::none;
  double constant_s = 0;     ///< of a constant one
  double agent_share = 0.5;  ///< of it that lies between agent and ledger; the rest: between ground and ledger
};
/// "none", "published", or seconds from 0 to 3.
Result<AddedDelay> added_delay_from(const std::string& text);

/// One of the two ways of an AddedDelay; the other way is another of these with a seed of its own. Constant: its share,
/// usually a half.
/// Published: a gamma distribution, such that both ways and the embedded ledger's own few milliseconds have a median of
/// 0.46 s and a tail beyond 0.8 s (the published square, one drone: 0.396, 0.456, 0.525 s, whiskers 0.313 to 0.711 s).
/// It is drawn anew every 100 ms, so what is sent meanwhile stays together; another share than a half stretches it.
/// Drawing: Marsaglia and Tsang, A simple method for generating gamma variables, 2000. Deterministic for a seed; one
/// thread.
class WayDelay {
 public:
  WayDelay(const AddedDelay& delay, double share, std::uint64_t seed) : delay_(delay), share_(share), random_(seed) {}
  /// Times must not go back.
  TimeNs at(TimeNs now);

 private:
  double gamma(double shape);
  AddedDelay delay_;
  double share_;
  Random random_;
  TimeNs next_draw_ns_ = 0;
  TimeNs drawn_ns_ = 0;
};

}  // namespace ledgerline::hil
