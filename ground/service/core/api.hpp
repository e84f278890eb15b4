#pragma once
#include <cstdint>
#include <deque>
#include <string>
#include <string_view>
#include <vector>

#include "ground/core/flight_types.hpp"

/// The ground station's API, version 1 (docs/station.md), without I/O: what a request means and what is answered. Each
/// function is pure; any thread.
namespace ledgerline::ground::service {

inline constexpr std::size_t max_body_bytes = 65'536;

enum class Level { info, warning, alarm };
/// Something that happened: told to every client, in order, once.
struct Event {
  std::uint64_t number = 0;  ///< from 1, without gaps
  TimeNs at_ns = 0;          ///< the ground's clock
  Level level = Level::info;
  std::string drone;  ///< empty: of none
  std::string text;
};

struct ApiRequest {
  std::string_view method, target, body;
};
struct ApiAnswer {
  unsigned status = 200;
  std::string body;  ///< JSON
  std::vector<PilotWish> wishes{};
};
ApiAnswer refusal(unsigned status, const std::string& words);

/// What there is to know, as Board last told it.
struct Known {
  const std::vector<std::string>& names;  ///< of the drones, as FlightConfig has them
  std::string_view drones;                ///< JSON: [DRONE...]
  const std::deque<Event>& events;        ///< oldest first
};
/// A request below /api/v1/ that has passed the guard.
ApiAnswer answer(const ApiRequest& request, const Known& known);

/// What a client of the stream says: {"op":"velocity", ...}. The error says what is wrong with it.
Result<PilotWish> wish_from(std::string_view message, const std::vector<std::string>& names, TimeNs now);

/// What one wish adds to those that wait for the same drone.
void merge(const PilotWish& wish, PilotWish& waiting);

/// {"op":"events","events":[...]}, those from `first` on.
std::string events_message(const std::deque<Event>& events, std::size_t first);

}  // namespace ledgerline::ground::service
