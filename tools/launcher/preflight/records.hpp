#pragma once
#include <string>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "tools/launcher/preflight/check.hpp"

namespace ledgerline::fly {

/// Fills in each drone's lease from a line that `ledgerline-control show --json` printed of all records; a drone that
/// is in none of them is not enrolled. `self`: who will fly. Another line is an error, and changes nothing. Pure.
Status take_records(const std::string& line, const crypto::IdentityName& self, Facts& facts);

}  // namespace ledgerline::fly
