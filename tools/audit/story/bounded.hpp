#pragma once
#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "common/rt/clock.hpp"

/// Lists that stay small however long a chain is. Each says what it has left out. One thread.
namespace ledgerline::audit {

/// The first ones; of those behind them their number alone.
template <typename T>
class FirstOnes {
 public:
  explicit FirstOnes(std::size_t max) : max_(max) {}
  void add(T one) {
    if (all_.size() < max_) {
      all_.push_back(std::move(one));
    } else {
      ++left_out_;
    }
  }
  const std::vector<T>& all() const { return all_; }
  T* last() { return left_out_ > 0 || all_.empty() ? nullptr : &all_.back(); }
  std::uint64_t left_out() const { return left_out_; }
  std::uint64_t count() const { return all_.size() + left_out_; }

 private:
  std::size_t max_;
  std::vector<T> all_;
  std::uint64_t left_out_ = 0;
};

/// Every one at first, then every second, every fourth ...: from `max` / 2 to `max` of them, evenly over the whole.
template <typename T>
class Thinned {
 public:
  explicit Thinned(std::size_t max) : max_(max) {}
  void add(const T& one) {
    if (seen_++ % step_ != 0) return;
    all_.push_back(one);
    if (all_.size() < max_) return;
    for (std::size_t i = 0; 2 * i < all_.size(); ++i) all_[i] = all_[2 * i];
    all_.resize((all_.size() + 1) / 2);
    step_ *= 2;
  }
  const std::vector<T>& all() const { return all_; }
  std::uint64_t seen() const { return seen_; }
  std::uint64_t step() const { return step_; }

 private:
  std::size_t max_;
  std::vector<T> all_;
  std::uint64_t seen_ = 0, step_ = 1;
};

/// How many when: a second each at first, and twice as long each time that there would be too many of them.
class OverTime {
 public:
  void add(TimeNs at_ns, bool good) {
    if (at_ns <= 0) return;  // a client that claims no time of our age
    auto& [valid, invalid] = counts_[at_ns / width_ns_];
    ++(good ? valid : invalid);
    while (counts_.size() > max_) widen();
  }
  TimeNs width_ns() const { return width_ns_; }
  /// Number of the interval since 1970 -> valid, invalid.
  const std::map<std::int64_t, std::pair<std::uint64_t, std::uint64_t>>& counts() const { return counts_; }

 private:
  static constexpr std::size_t max_ = 600;
  void widen() {
    width_ns_ *= 2;
    std::map<std::int64_t, std::pair<std::uint64_t, std::uint64_t>> wider;
    for (const auto& [at, both] : counts_) {
      wider[at / 2].first += both.first;
      wider[at / 2].second += both.second;
    }
    counts_ = std::move(wider);
  }
  TimeNs width_ns_ = ns_per_s;
  std::map<std::int64_t, std::pair<std::uint64_t, std::uint64_t>> counts_;
};

}  // namespace ledgerline::audit
