#pragma once
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/identities/wiping_string.hpp"
#include "ground/core/flight_types.hpp"
#include "ground/mission/check.hpp"
#include "ground/mission/mission.hpp"
#include "ground/service/core/drone_queries.hpp"
#include "ground/service/core/fault_switches.hpp"
#include "ground/service/operators/calls.hpp"
#include "ground/service/operators/sign_ins.hpp"

/// The ground station's API, version 1 (docs/station.md), without I/O: what a request means and what is answered. Each
/// function is pure; any thread.
namespace ledgerline::ground::service {

inline constexpr std::size_t max_body_bytes = 65'536;
inline constexpr std::size_t max_mission_body_bytes = mission::max_mission_bytes;
/// Of the body of a request for this target.
std::size_t body_limit(std::string_view target);

using ground::Level;
/// Something that happened: sent to every client, in order, once.
struct Event {
  std::uint64_t number = 0;  ///< from 1, without gaps
  TimeNs at_ns = 0;          ///< the ground's clock
  Level level = Level::info;
  std::string drone;  ///< empty: of none
  std::string text;
};

struct ApiRequest {
  std::string_view method, target, body;
  std::optional<std::size_t> who{};  ///< the operator that is signed in
  std::string_view content_type{};
  bool session_ended = false;  ///< it may stop and land drones, and nothing else
};
inline constexpr const char* session_over = "the session is over: it may still stop and land, and nothing else";
/// Somebody signs in.
struct SignIn {
  std::size_t who = 0;
  std::shared_ptr<const crypto::WipingString> pass_phrase{};  ///< gone with the last who has it
};
/// What a client asks of the station's missions.
struct MissionRequest {
  enum class Kind { list, show, add, approve, withdraw, start, pause, resume, land, remove };
  Kind kind = Kind::list;
  std::string id;                            ///< of all but list and add
  std::string text;                          ///< of add
  bool csv = false;                          ///< of add: CSV, else JSON
  std::string name;                          ///< of add, CSV: the mission's
  std::optional<std::size_t> who{};          ///< index of the operator who asks; none: ground's own identity signs
  std::optional<crypto::IdentityName> by{};  ///< likewise
  std::string asker{};                       ///< for people: "alice", "the page's token"
};
/// What is done before the answer goes out: one of these at most.
struct ApiAnswer {
  unsigned status = 200;
  std::string body;  ///< JSON
  std::vector<PilotCommand> commands{};
  bool confirmed = false;              ///< that a drone is cut which is in the air
  std::optional<OperatorCall> call{};  ///< to be signed by who asked
  std::optional<SignIn> sign_in{};
  bool sign_out = false;
  std::optional<MissionRequest> mission{};
  std::optional<FaultRequest> fault{};
};
std::string text_of(const crypto::IdentityName& who);  ///< "Org2MSP CN=..."
ApiAnswer refusal(unsigned status, const std::string& words);

/// What Board reports of a moment: texts of JSON.
struct BoardState {
  std::string drones{};                ///< [DRONE...]
  std::string state{};                 ///< the stream's message around it
  std::optional<std::string> paths{};  ///< {"tello1":[[x,y,z]...]}; nothing: as before
  std::vector<Event> events{};
  std::vector<std::size_t> aloft{};    ///< indexes of the drones that are off the ground, or not known to be on it
  std::vector<std::size_t> stopped{};  ///< indexes of the drones that somebody has stopped
  std::vector<std::size_t> stopped_by_ground{};  ///< those that ground alone has stopped
  std::vector<std::size_t> unplaced{};           ///< indexes of the drones whose position is not known
  std::vector<LeaseState> leases{};              ///< of all drones
  std::vector<GroundPhase> phases{};             ///< of all drones
};

/// What there is to know, as Board last reported it.
struct ApiContext {
  const std::vector<std::string>& names;   ///< of the drones, as FlightConfig has them
  std::string_view drones, paths;          ///< as in BoardState
  const std::deque<Event>& events;         ///< oldest first
  const std::vector<Operator>& operators;  ///< who may sign in; none: ground's own identity signs all
  const FaultList* faults = nullptr;       ///< null: none are switched here
  std::span<const std::size_t> aloft{}, stopped{}, stopped_by_ground{}, unplaced{};  ///< as in BoardState
  std::span<const LeaseState> leases{};   ///< as in BoardState; none: not known yet
  std::span<const GroundPhase> phases{};  ///< as in BoardState; none: not known yet
  bool manual = true;                     ///< else each drone flies its flight's path
  const mission::Fence* fence = nullptr;  ///< of paths; null: none is known
  double height_m = 1;                    ///< of waypoints without one
  TimeNs now_ns = 0;                      ///< ground's clock
};
/// A request below /api/v1/ that has passed the guard.
ApiAnswer answer(const ApiRequest& request, const ApiContext& known);
/// Index of a drone; nothing: there is none of that name.
std::optional<std::size_t> drone_of(const std::vector<std::string>& names, std::string_view name);

/// What one command adds to those that wait for the same drone.
void merge(const PilotCommand& command, PilotCommand& waiting);

/// {"session":TOKEN,"operator":"alice","identity":"Org2MSP CN=..."}
std::string session_text(const std::string& token, const Operator& who);
/// {"op":"missions","missions":[...]}
std::string missions_message(std::string_view list);
/// {"op":"paths","paths":{...}}
std::string paths_message(std::string_view paths);
/// {"op":"events","events":[...]}, those from `first` on.
std::string events_message(const std::deque<Event>& events, std::size_t first);

}  // namespace ledgerline::ground::service
