#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "tools/station/core/requests.hpp"

/// The station's answers as text for people. What comes from there is made printable; an answer that is not what
/// version 1 of the API says is an error.
namespace ledgerline::station {

using Rows = std::vector<std::vector<std::string>>;  ///< the first one is the heading

/// "tello2: " and the text, which may name that drone itself, at its beginning or behind a colon: it is named once.
std::string of_drone(const std::string& name, std::string text);

/// Columns as wide as what is in them, two blanks apart.
std::string aligned(const Rows& rows);

/// Of GET drones.
Result<Rows> drone_rows(std::string_view body);
/// The same without what changes all the time: equal, nothing has changed that is worth a new table.
Rows settled(Rows rows);
/// Of a drone's requests the only one's; an error says how many there are.
Result<crypto::IdentityName> only_requester(std::string_view body, const std::string& name);

/// "takeoff" brings a drone into the air; "land", "stop" and "cut" to the ground, the last two with a stop on the
/// ledger.
bool has_an_end(std::string_view verb);
/// Whether all of `names` (none: all that are listed) are where `verb` brings them. An error: one failed, and why. Of
/// GET drones.
Result<bool> all_arrived(std::string_view body, const std::vector<std::string>& names, std::string_view verb);
/// Whether nobody has this drone stopped. Of GET drones.
Result<bool> is_cleared(std::string_view body, const std::string& name);
/// Whom `verb` with --all is for: clear_stop those that are stopped, acquire those that nobody holds, request those
/// that others hold, release those that `self` holds, land those that are not down. Of GET drones.
Result<std::vector<std::string>> drones_for(std::string_view body, std::string_view verb, const std::string& self);
/// Whether a mission has been flown to its end. An error: it was ended before, and why. Of GET missions/ID.
Result<bool> is_flown(std::string_view body);

/// Of GET missions.
Result<Rows> mission_rows(std::string_view body);
/// The one of that digest, as mission_text() takes it; empty: there is none. Of GET missions.
Result<std::string> mission_with(std::string_view body, const std::string& digest);
/// Of GET missions/ID, or of what POST missions answers.
Result<std::string> mission_text(std::string_view body);

/// Of a mission's file, against what `ledgerline audit` lists.
std::string digests_text(const MissionDigests& digests);
std::string digests_json(const MissionDigests& digests, const std::string& at_station = "null");

struct Approvals {
  std::string name;                    ///< of the mission
  std::vector<std::string> signers{};  ///< "Org2MSP CN=..."
};
/// Whether an event's text is the ledger's refusal of who has approved before.
bool is_anchored_already(std::string_view text);
/// That refusal is of one of these signers, so the approval counts.
bool counts_already(const Approvals& approvals, std::string_view text);
/// Of GET missions/ID.
Result<Approvals> approvals_from(std::string_view body);

struct ShownEvent {
  std::uint64_t number = 0;
  double t_ms = 0;  ///< ground's clock
  std::string level, drone, text;
};
/// Of GET events, in order.
Result<std::vector<ShownEvent>> events_from(std::string_view body);
/// Of the same answer: ground's clock.
Result<double> now_ms_from(std::string_view body);
/// "12:00:01  alarm    tello1  stopped by ...".
std::string event_line(const ShownEvent& event, const std::string& time);

/// What is in the air, and the missions in progress.
struct ActiveFlight {
  std::string what{};     ///< "mission", "path" or "hand"
  std::string mission{};  ///< its id, of a mission
  std::string name{};     ///< its name
  std::vector<std::string> drones{};
  std::string phase{};
  std::string by{};                 ///< who started it, or who commands the drone
  std::optional<double> since_s{};  ///< from the first take-off; nothing: longer ago than the events that are kept
};
/// Of GET drones, GET missions and GET events; `t_ms`: ground's clock now.
Result<std::vector<ActiveFlight>> active_flights_from(std::string_view drones, std::string_view missions,
                                                      const std::vector<ShownEvent>& events, double t_ms);
Rows active_flight_rows(const std::vector<ActiveFlight>& flown);
std::string active_flights_json(const std::vector<ActiveFlight>& flown);  ///< {"flights":[...]}

}  // namespace ledgerline::station
