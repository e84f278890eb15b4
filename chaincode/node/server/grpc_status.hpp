#pragma once
#include <grpcpp/support/status.h>

#include <string>

#include "chaincode/node/core/types.hpp"
#include "chaincode/node/server/limit.hpp"

namespace ledgerline::node {

/// With a gateway.ErrorDetail (address, MSP id, `detail`) as Fabric's gateway attaches it; none when `detail` is empty.
grpc::Status make_status(grpc::StatusCode code, const std::string& message, const std::string& detail = {});
grpc::Status make_status(const Reply& reply);
/// The queue to the core is full.
grpc::Status overloaded();
/// As many calls of this service are open as may be.
inline grpc::Status too_many(const Limit& limit) { return {grpc::StatusCode::RESOURCE_EXHAUSTED, limit.refusal()}; }

}  // namespace ledgerline::node
