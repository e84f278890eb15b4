#pragma once
#include <mutex>

#include "common/rt/histogram.hpp"

namespace ledgerline::fabric {

/// How long after the orderers the own peer delivered the same blocks, of those that were taken as they were ordered.
/// Any thread.
class Confirmations {
 public:
  /// As Client::StreamHandlers::on_confirmed has them.
  void add(TimeNs ordered_ns, TimeNs confirmed_ns) {
    const std::lock_guard lock(mutex_);
    behind_.add(confirmed_ns - ordered_ns);
  }
  Quantiles quantiles_ms() const {
    const std::lock_guard lock(mutex_);
    return behind_.quantiles_ms();
  }

 private:
  mutable std::mutex mutex_;
  Histogram behind_;
};

}  // namespace ledgerline::fabric
