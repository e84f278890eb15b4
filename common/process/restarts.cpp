#include "common/process/restarts.hpp"

#include <algorithm>

namespace ledgerline {

std::optional<TimeNs> Restarts::ended(TimeNs now) {
  while (!recent_.empty() && now - recent_.front() > limits_.within) recent_.pop_front();
  if (recent_.size() >= static_cast<std::size_t>(limits_.max_restarts)) return std::nullopt;
  TimeNs wait = limits_.first_wait;
  for (std::size_t i = 0; i < recent_.size() && wait < limits_.max_wait; ++i) wait *= 2;
  wait = std::min(wait, limits_.max_wait);
  recent_.push_back(now);
  ++count_;
  return now + static_cast<TimeNs>(static_cast<double>(wait) * (0.5 + random_.uniform() / 2));
}

}  // namespace ledgerline
