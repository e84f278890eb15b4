#pragma once
#include <algorithm>

#include "common/rt/clock.hpp"

namespace ledgerline::node {

/// A count that is forgiven with time: so many a second.
class LeakyAccount {
 public:
  double at(TimeNs now_ns, double per_s) const {
    return std::max(0.0, count_ - static_cast<double>(now_ns - at_ns_) / ns_per_s * per_s);
  }
  void add(double count, TimeNs now_ns, double per_s) {
    count_ = at(now_ns, per_s) + count;
    at_ns_ = now_ns;
  }

 private:
  double count_ = 0;
  TimeNs at_ns_ = 0;
};

}  // namespace ledgerline::node
