#pragma once
#include "common/base/result.hpp"
#include "common/fabric/client/client.hpp"
#include "common/rt/clock.hpp"

/// How long a channel's way of cutting blocks lets its clients wait.
namespace ledgerline::fabric {

/// What `timeouts` of [ledger] adds to limits of time: 0 where it is fixed. Of config_block where there is one, so that
/// no peer can lengthen them, else of the peer, which must answer then. Logs what it costs.
Result<TimeNs> added_timeout(const ClientConfig& config);

/// The same, of one of a program's channels: its deadline grows, and an error names it.
Result<TimeNs> take_timeouts(ClientConfig& config);

}  // namespace ledgerline::fabric
