#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::topics {

/// One topic in one direction, as a bridge reports it.
struct Row {
  std::string channel, topic, id, direction;
  double messages = 0, bytes = 0, batches = 0, median_ms = 0, p99_ms = 0;
  std::string drops;  ///< "overflow 3 rate 17"
};

struct Status {
  double time_s = 0;  ///< CLOCK_MONOTONIC of its host
  std::vector<Row> rows;
  std::vector<std::string> unreached;  ///< channels whose ledger is not reached
};

/// A bridge's status as `file` has it. An error, which names the file, where it is none, or where its bridge has been
/// silent for too long at `now` (CLOCK_MONOTONIC of the same host).
Result<Status> parse_status(std::string_view text, const std::string& file, TimeNs now);

/// One line a topic. Rates are from `before` to `now`, two statuses of one bridge; the same one twice: no rates.
std::string table(const Status& before, const Status& now);

}  // namespace ledgerline::topics
