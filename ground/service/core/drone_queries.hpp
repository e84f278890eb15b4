#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "ground/core/flight_view.hpp"

/// What the service asks of the flights' drones. On the flight's thread.
namespace ledgerline::ground::service {

/// Whether a drone is off the ground, as far as is known: by what it flies for us, or as its newest state says.
bool is_aloft(const FlightView& flights, std::size_t drone);
/// Indexes of those, and of the ones of which nothing is known yet.
std::vector<std::size_t> aloft_of(const FlightView& flights);
/// Indexes of the drones that somebody has stopped.
std::vector<std::size_t> stopped_of(const FlightView& flights);
/// Those whose position is not known: they fly no path.
std::vector<std::size_t> unplaced_of(const FlightView& flights);
/// Indexes of the drones that ground's own identity has stopped, and nobody else.
std::vector<std::size_t> stopped_by_ground(const FlightView& flights);

/// What decides whether a drone's orders are taken.
struct LeaseState {
  std::optional<crypto::IdentityName> holder{};
  std::string words{};  ///< "its lease is held by CN=alice"
  bool ours = false;    ///< ground commands it
};
/// Of all drones.
std::vector<LeaseState> leases_of(const FlightView& flights);

/// What somebody holds that we command for him.
struct HeldDrones {
  std::vector<std::size_t> drones{};
  std::vector<std::size_t> aloft{};  ///< of these
};
HeldDrones drones_held_by(const FlightView& flights, const crypto::IdentityName& who);

}  // namespace ledgerline::ground::service
