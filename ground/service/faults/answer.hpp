#pragma once
#include "ground/service/core/api.hpp"

namespace ledgerline::ground::service {

/// A request for /api/v1/faults. What it switches is asked for by the answer's `fault`. Pure; any thread.
ApiAnswer answer_faults(const ApiRequest& request, const ApiContext& known);

}  // namespace ledgerline::ground::service
