#pragma once
#include <nlohmann/json.hpp>

#include "common/bridge/core/downlink.hpp"
#include "common/bridge/core/uplink.hpp"

namespace ledgerline::bridge {

/// Each topic with what it cost and lost: topic, type, id, direction, messages, bytes, batches, pending, missing,
/// age_ms, drops by reason (those that there are).
nlohmann::json report(const Uplink& uplink);
nlohmann::json report(const Downlink& downlink);

}  // namespace ledgerline::bridge
