#pragma once
#include "common/base/result.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/judge/channel_config.hpp"
#include "common/rt/clock.hpp"

/// How long a channel's way of cutting blocks lets its clients wait.
namespace ledgerline::fabric {

/// A state comes in one block, and the command that it led to in another: twice BatchTimeout, at most 55 s (limits end at
/// a minute). 0 where each transaction has a block of its own.
TimeNs both_ways_ns(const Batching& batching);

/// What `patience` of [ledger] adds to limits of time: 0 where it is fixed. Of config_block where there is one, so that no
/// peer can lengthen them, else of the peer, which must answer then. Logs what it costs.
Result<TimeNs> added_patience(const ClientConfig& config);

}  // namespace ledgerline::fabric
