#pragma once
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "common/rt/clock.hpp"

namespace ledgerline::fabric {

/// Which changes of a stream's connection are worth a line in the log. A ledger that refuses a stream ends each
/// connection just behind its begin, once a second, for as long as the cause lasts. Pure; one thread.
///
///     lost: logged ──▶ for the same reason within the rest: counted ──▶ behind it: logged with the count, rest doubles
///     connected: logged where the loss before it was, and at first
class ConnectionWords {
 public:
  /// Halved, a stream that is refused for an hour makes twice as many lines; doubled, a person waits longer for the
  /// news.
  static constexpr TimeNs first_rest_ns = 2 * ns_per_s, max_rest_ns = 120 * ns_per_s;

  /// What to say of a connection, or its end for a reason; none: nothing.
  std::optional<std::string> on(bool connected, const std::string& why, TimeNs now) {
    return connected ? on_connected() : on_lost(why, now);
  }

 private:
  std::optional<std::string> on_connected() {
    if (!std::exchange(lost_is_reported_, false)) return std::nullopt;
    return "connected";
  }
  std::optional<std::string> on_lost(const std::string& why, TimeNs now) {
    const bool again = why == why_ && now - lost_ns_ < max_rest_ns;
    lost_ns_ = now;
    if (again && now < rests_until_ns_) {
      ++unreported_;
      return std::nullopt;
    }
    rest_ns_ = again ? std::min(2 * rest_ns_, max_rest_ns) : first_rest_ns;
    rests_until_ns_ = now + rest_ns_;
    why_ = why;
    lost_is_reported_ = true;
    const std::uint64_t unreported = std::exchange(unreported_, 0);
    return again && unreported > 0 ? fmt::format("{} ({} times more since it was reported)", why, unreported) : why;
  }

  std::string why_;  ///< that was reported
  TimeNs lost_ns_ = 0, rest_ns_ = first_rest_ns, rests_until_ns_ = INT64_MIN;
  std::uint64_t unreported_ = 0;
  bool lost_is_reported_ = true;  ///< the first connection is news
};

}  // namespace ledgerline::fabric
