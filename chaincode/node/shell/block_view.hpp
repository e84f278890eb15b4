#pragma once
#include <string_view>

#include "common/base/result.hpp"
#include "common/common.pb.h"
#include "gateway/gateway.pb.h"
#include "orderer/ab.pb.h"
#include "peer/events.pb.h"

/// A committed block as each service shows it.
namespace ledgerline::node {

Status fill_peer(std::string_view block, protos::DeliverResponse& response);
/// Without payloads of events, as Fabric's filtered blocks.
Status fill_filtered(std::string_view block, protos::DeliverResponse& response);
/// The contract keeps no private data, so there is none beside the block.
Status fill_with_private_data(std::string_view block, protos::DeliverResponse& response);
/// Without the peer's flags.
Status fill_orderer(std::string_view block, orderer::DeliverResponse& response);
/// The contract's events of valid transactions; those up to `after` (a transaction's id) are left out if it is in the
/// block.
Status fill_events(std::string_view block, const std::string& contract, const std::string& after,
                   gateway::ChaincodeEventsResponse& response);

}  // namespace ledgerline::node
