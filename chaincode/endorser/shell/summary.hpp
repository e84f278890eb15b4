#pragma once
#include <string>

#include "chaincode/endorser/shell/service.hpp"

namespace ledgerline::endorser {

/// JSON, one key a count.
Status write_summary(const std::string& path, const Service::Counts& counts);

}  // namespace ledgerline::endorser
