#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "tools/tello/core/show.hpp"

namespace ledgerline::tello {

/// Asks all of them at once, few enough datagrams a second for any Wi-Fi, until each has answered or was given up.
/// `interface` empty: wherever routes lead. Ends early when a signal asks to.
Status ask(std::vector<Found>& drones, const std::string& interface);

/// True once it is down; false when it was not seen down within `seconds`. Says on the log what came of it.
Result<bool> land(std::uint32_t address, const std::string& interface, double seconds);

/// From a file (its first line), or asked for at the terminal, without echo.
Result<std::string> read_password(const std::string& file);

}  // namespace ledgerline::tello
