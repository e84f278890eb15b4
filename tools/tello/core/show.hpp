#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "tools/tello/core/asking.hpp"

namespace ledgerline::tello {

/// What is asked of a Tello that is found: neighbours in this order have answers of different shapes (Asking).
const std::vector<std::string>& questions_of_info();

struct Found {
  std::uint32_t address = 0;
  Asking asking;
};

/// A table, a line each; what a drone does not say is said so.
std::string words(const std::vector<Found>& drones);
/// {"drones":[{"address":"192.168.10.1","serial":"...","battery":87,"sdk":"20","hardware":"TELLO","wifi_version":"..."}]};
/// null: it does not say.
std::string json(const std::vector<Found>& drones);

}  // namespace ledgerline::tello
