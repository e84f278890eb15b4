#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "hil/fault/kinds/real_acts.hpp"
#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// All that is wrong with a script without flying it, each as "FILE:LINE: key: what". `real`: for a flight with the
/// real processes on this ledger: then also whatever they cannot have. One that nobody flies in simulated time is for
/// them anyway.
Result<Script> check_script(std::string_view toml, const std::string& file, const std::optional<RealStack>& real = {});

}  // namespace ledgerline::hil
