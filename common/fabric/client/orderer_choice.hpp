#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "common/rt/clock.hpp"

namespace ledgerline::fabric {

/// Which orderer an envelope goes to. A follower of Raft takes an envelope as well, checks it, and hands it on to the
/// leader, which checks it once more; no orderer says who leads. So it is measured: how long an envelope takes from its
/// sending until it is seen in a block. The machine's load moves that by far more than a follower's hop does, so a
/// probe is compared with the envelope before it alone, and what counts is how often it was sooner.
///
///     best ──▶ one envelope in probe_every goes to another one ──▶ in two of three sooner there: that is the best now
///     best fails ──▶ the next one, and all is measured again, more often at first
///
/// Only an envelope with none of ours before it still on its way may go to another one than the best, or change the
/// best: two orderers do not keep the order of one client's envelopes. With one orderer it is always that. Pure, one
/// thread.
class OrdererChoice {
 public:
  // A probe costs what a follower costs, about a millisecond: one in twenty keeps the mean within 0.05 ms of the best.
  static constexpr std::uint64_t probe_every = 20, first_probe_every = 4;
  /// Of 31 pairs between equals 21 are of one sign once in thirty times, and where the other takes a millisecond more
  /// of ten, as noisy as on a busy machine (37 in 100 are sooner), once in some thousand.
  static constexpr std::size_t pairs = 31, sooner_of_them = 21;
  static constexpr TimeNs max_age_ns = 180 * ns_per_s;  ///< another one may have led then
  static constexpr TimeNs max_apart_ns = ns_per_s / 2;  ///< of a pair's two envelopes
  static constexpr TimeNs min_gain_ns = ns_per_ms / 5;  ///< of the median pair
  /// Without a probe; twice as long each time, since an envelope waits for each that fails.
  static constexpr TimeNs first_rest_ns = 10 * ns_per_s, max_rest_ns = 640 * ns_per_s;

  explicit OrdererChoice(std::size_t orderers) : orderers_(orderers) {}

  std::size_t best() const { return best_; }

  /// For the next envelope; `may_probe`: it may be late, and none of ours is on its way.
  std::size_t next(TimeNs now, bool may_probe) {
    ++envelopes_;
    if (orderers_.size() < 2 || !may_probe) return best_;
    improve(now);
    const auto probed = to_probe(now);
    if (!probed) return best_;
    envelopes_ = 0;
    return *probed;
  }

  /// An envelope that went to this orderer, and to no other, was seen in a block so long after it was sent.
  void on_committed(std::size_t orderer, TimeNs took_ns, TimeNs now) {
    Orderer& one = orderers_[orderer];
    one.rest_ns = first_rest_ns;
    if (orderer == best_) {
      newest_ = {now, took_ns};
    } else if (newest_ && now - newest_->at_ns <= max_apart_ns) {
      one.longer.push_back({now, took_ns - newest_->took_ns});
      if (one.longer.size() > pairs) one.longer.pop_front();
    }
  }

  /// This orderer did not accept the envelope; `next` is asked in its place, and becomes the best if this one was.
  void failed(std::size_t orderer, std::size_t next, TimeNs now) {
    Orderer& failed = orderers_[orderer];
    failed.rests_until_ns = now + failed.rest_ns;
    failed.rest_ns = std::min(2 * failed.rest_ns, max_rest_ns);
    if (orderer == best_) become(next);
  }

 private:
  struct Sample {
    TimeNs at_ns = 0, took_ns = 0;
  };
  struct Orderer {
    std::deque<Sample> longer{};  ///< than the best, pair by pair
    TimeNs rests_until_ns = INT64_MIN, rest_ns = first_rest_ns;
  };

  /// What was measured is over: it was beside another one.
  void become(std::size_t best) {
    best_ = best;
    newest_.reset();
    for (Orderer& one : orderers_) one.longer.clear();
  }

  /// By how much the other one is sooner; 0: that is not known.
  static TimeNs gain(const Orderer& other) {
    if (other.longer.size() < pairs) return 0;
    std::vector<TimeNs> times;
    for (const Sample& one : other.longer) times.push_back(one.took_ns);
    std::sort(times.begin(), times.end());
    const TimeNs median = times[pairs / 2];
    return times[sooner_of_them - 1] < 0 && median <= -min_gain_ns ? -median : 0;
  }

  void improve(TimeNs now) {
    std::pair<TimeNs, std::size_t> most{0, best_};
    for (std::size_t i = 0; i < orderers_.size(); ++i) {
      Orderer& one = orderers_[i];
      while (!one.longer.empty() && now - one.longer.front().at_ns > max_age_ns) one.longer.pop_front();
      if (i != best_ && now >= one.rests_until_ns) most = std::max(most, {gain(one), i});
    }
    if (most.first > 0) become(most.second);
  }

  std::optional<std::size_t> to_probe(TimeNs now) {
    for (std::size_t k = 1; k <= orderers_.size(); ++k) {
      const std::size_t i = (probed_ + k) % orderers_.size();
      const Orderer& one = orderers_[i];
      if (i == best_ || now < one.rests_until_ns) continue;
      if (envelopes_ < (one.longer.size() < pairs ? first_probe_every : probe_every)) continue;
      probed_ = i;
      return i;
    }
    return std::nullopt;
  }

  std::vector<Orderer> orderers_;
  std::size_t best_ = 0, probed_ = 0;
  std::optional<Sample> newest_{};  ///< of the best
  std::uint64_t envelopes_ = 0;     ///< since the last probe
};

}  // namespace ledgerline::fabric
