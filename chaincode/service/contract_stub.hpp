#pragma once
#include "chaincode/contract/stub.hpp"
#include "chaincode/shim/shim.hpp"

namespace ledgerline::chaincode {

/// The contract on Fabric: each call of it that a peer sends, with the same answers and refusals as in the embedded
/// node. The caller's name comes from the creator's certificate, which the peer has checked. Thread-safe.
shim::Response invoke_on_fabric(shim::Stub& stub);

}  // namespace ledgerline::chaincode
