#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/result.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"
#include "hil/sitl/observation.hpp"
#include "hil/sitl/world.hpp"

namespace ledgerline::hil {

/// A moment of a flight, as text: "5s" (of the run), "takeoff" (it leaves the ground), "flying", "path", "lap 2" (it
/// begins), "height 0.5", "landing", "landed"; each but the first with "+ 2s" behind it, if wanted. Of the fault's
/// drone; of the first one that gets there where the fault is no drone's.
struct Trigger {
  enum class Kind : std::uint8_t { time, takeoff, flying, path, lap, height, landing, landed };
  Kind kind = Kind::time;
  double value = 0;                                                           ///< the lap's number; the height [m]
  TimeNs after_ns = 0;                                                        ///< time: the moment itself
  bool of_a_path() const { return kind == Kind::path || kind == Kind::lap; }  ///< ground flies one
  bool reached(TimeNs now, const DroneObservation& drone) const;              ///< without `after_ns`; not for time
};
Result<Trigger> parse_trigger(std::string_view text);

/// A moment that is waited for, of the drones that are named.
struct TriggerWatch {
  /// `name`: of one drone; empty: all.
  TriggerWatch(const Trigger& its_trigger, std::string_view name, std::span<const DroneObservation> all);
  /// Whether it has come; to be called in each step. `now` is since the run's beginning.
  bool is_due(TimeNs now, std::span<const DroneObservation> all);

  Trigger trigger;
  std::vector<std::size_t> drones;   ///< indices
  std::optional<TimeNs> reached_ns;  ///< without the trigger's `after_ns`
};

/// So many drones that nothing is known of but their names and numbers.
std::vector<DroneObservation> named_drones(int count);

/// What a script is flown on with the real processes.
struct RealStack {
  bool fabric = false;  ///< its ledger, with three orderers; else the embedded node
  bool shim = false;  ///< drones behind the shim (docs/faults.md), which knows the SDK's calls; else UDP and the proxy
};
inline constexpr int fabric_orderers = 3;
inline constexpr const char* leader_part = "orderer leader";

/// Its connections to the ledger, as the proxy knows them: "agent", "agent-orderer1" and so on.
std::string servers_of(Process process);

/// What is to be done when a fault begins, or ends: in this order.
struct RealActs {
  std::vector<std::string> proxy;                     ///< commands of hil/proxy/switches.hpp, also the shim's
  std::vector<std::pair<std::string, int>> programs;  ///< signals to programs of the flight: "ledgerline-agent"
  /// Signals to parts of Fabric's network: "peer1"; leader_part: the orderer that leads.
  std::vector<std::pair<std::string, int>> parts;
  std::vector<std::string> control;  ///< arguments of ledgerline control
  int burn_core = -1;                ///< begin, or no longer, to compute on this core
  std::uint64_t take_bytes = 0;      ///< memory to take, or to give back
  bool fill_disk = false;            ///< to fill the ledger's disk, or to make room again
};

/// What all faults that go on now make of a world together: faults may overlap, so the whole is recomputed whenever one
/// begins or ends. Plain data.
struct Effects {
  struct OfDrone {
    std::array<Impairment, drone_traffic_count> impairments;
    std::vector<SensorFault> sensors;
    std::vector<SdkFault> sdk;
    MocapFault mocap;
    double drain_per_s = 0;
    sim::Sensing sensing;
    Impairment& impairment(DroneTraffic at) { return impairments[static_cast<std::size_t>(at)]; }
    const Impairment& impairment(DroneTraffic at) const { return impairments[static_cast<std::size_t>(at)]; }
  };
  /// A process' connection to the ledger.
  struct OfPort {
    bool cut = false, stale = false, stall_to = false, stall_from = false;
    std::optional<Distribution> delay_to, delay_from;
    Tampering tampering = Tampering::none;
    PeerTampering serves = PeerTampering::none, orders = PeerTampering::none;
    Slip slip = Slip::none;
  };
  struct OfRelay {
    RelayTampering tampering = RelayTampering::none;
    bool compared = false;  ///< clients compare events before they sign
  };

  explicit Effects(std::size_t drone_count) : drones(drone_count) {}

  std::vector<OfDrone> drones;
  std::array<OfPort, process_count> ports;  ///< by Process; link has none
  std::array<bool, process_count> stopped{};
  std::optional<OfRelay> relay;
  bool ledger_stalled = false;
  std::array<double, 2> clock_drift{};  ///< by WorldClock::Host: so much faster than real time
  std::array<double, 3> wind_mps{};

  OfPort& port(Process process) { return ports[static_cast<std::size_t>(process)]; }
  const OfPort& port(Process process) const { return ports[static_cast<std::size_t>(process)]; }
  void apply_to(SimulatedWorld& world) const;
};

struct Fault;

/// What a fault does, in simulated time and with the real processes, and what a checker may expect behind it. Its row
/// of the table makes it of the words of the script; a function that is empty does nothing.
struct FaultActs {
  // Simulated time.
  std::function<void(SimulatedWorld&, std::size_t drone)> strike{};  ///< at its beginning, each drone that it names
  std::function<void(SimulatedWorld&)> begin{};                      ///< behind that, once
  std::function<void(SimulatedWorld&)> end{};                        ///< unless the same words go on
  std::function<void(Effects&)> lasts{};                             ///< while it goes on
  /// The same, of each drone that it names; `item` is its number in the script.
  std::function<void(Effects::OfDrone&, std::size_t item)> lasts_on{};

  // The real processes; what `lasts` and `lasts_on` do to drones' networks and connections is done by the proxy.
  std::function<void(RealActs&, const RealStack&)> really_begin{};
  std::function<void(RealActs&, const RealStack&, bool goes_on)> really_end{};  ///< `goes_on`: the same words do
  /// The error says why it cannot be.
  std::function<Status(const Fault&, const RealStack&)> check_real = [](const Fault&, const RealStack&) -> Status {
    return done;
  };

  /// The error says why it would do nothing in such a flight.
  std::function<Status(const WorldConfig&)> check_flight = [](const WorldConfig&) -> Status { return done; };

  // Properties.
  bool momentary = false;          ///< over by itself as soon as it began
  bool pushes = false;             ///< drones, from outside: how fast and how high they get says nothing
  bool breaks = false;             ///< drones, which may turn over
  bool for_good = false;           ///< what it does to drones outlasts it
  bool deafens = false;            ///< what a drone is sent may not get there
  bool stops_link = false;         ///< drones are sent nothing until link runs again
  bool needs_supervisors = false;  ///< others than the operator speak
  bool cuts = false;               ///< motors, as somebody asks for by name
  bool blinds = false;             ///< a drone's own velocity: it cannot know how far it goes meanwhile
  double misleads_m = 0;           ///< by how much mocap may say another place
  double misleads_mps = 0;         ///< how fast a position by onboard odometry may drift from the true one
  std::string_view kills = {};     ///< the program that dies by SIGKILL: "link"
  bool fills_disk = false;         ///< the ledger's has to be a small one
  bool of_two_drones = false;      ///< it needs a second one in the flight
};

/// One fault as it is written: where and what, e.g. "drone tello1 to delay 200ms". docs/faults.md lists all of them.
struct Fault {
  std::string text;         ///< with one blank between words
  std::string at = "path";  ///< as written
  Trigger trigger{Trigger::Kind::path, 0, 0};
  TimeNs for_ns = 0;      ///< 0: until the flight's end
  bool optional = false;  ///< its moment may never come; otherwise a run without it has not held
  std::string drone;      ///< empty: every drone
  FaultActs acts;

  bool names(std::string_view a_drone) const { return drone.empty() || drone == a_drone; }
};

/// A kind of fault: a row of the tables beside this file.
struct FaultKind {
  /// Words in lower case stand as they are, one of those with | between. NAME: a drone, or * for all of them; others
  /// in capitals: one word; with ... behind: all the rest.
  std::string_view form;
  struct ParsedText {
    std::string text;                     ///< all of it
    std::string drone;                    ///< NAME; empty: every drone
    std::vector<std::string_view> words;  ///< what stands for choices and for other words in capitals
    std::string rest;                     ///< what stands for ...
  };
  Result<FaultActs> (*make)(const ParsedText& parsed);
  bool real_only = false;  ///< simulated time has no such thing
};
std::span<const FaultKind> drone_faults(), sensing_faults(), ledger_faults(), process_faults(), machine_faults();
/// All of them, in one row of rows.
std::vector<const FaultKind*> fault_kinds();

/// `text` as in the table; what cannot be done in simulated time is refused with the reason, as is what a connection
/// cannot have. `for` and `at` are texts too; an empty `for` means until the end.
/// `real`: for a flight with the real processes, which has some faults more.
Result<Fault> parse_fault(std::string_view text, std::string_view at, std::string_view duration, bool real = false);
/// Its `for`: more than nothing.
Result<TimeNs> parse_fault_time(std::string_view duration);
/// The row whose words these are; the error says which there are.
Result<const FaultKind*> kind_of(std::string_view text, bool real);

/// That its moment never came, in words.
std::string never_text(const Fault& fault);

/// Whether a word of a form stands for something: it is in capitals.
bool is_placeholder(std::string_view word);

/// Faults of this kind, one for each way to choose among its words, with something sensible for its words in capitals:
/// "agent kill", "link kill", "ground kill". A script's fault takes each of them, or says why not. Empty: the form has
/// a word in capitals that nobody has given an example for (catalogue.cpp).
std::vector<std::string> examples_of(const FaultKind& kind);

/// How the examples of a fault kind (examples_of) fare in one mode: possible, or refused with a reason.
struct InMode {
  std::vector<std::string> possible;
  std::vector<std::pair<std::string, std::string>> refused;  ///< and why
  bool all() const { return refused.empty() && !possible.empty(); }
};
struct KindModes {
  const FaultKind* kind = nullptr;
  InMode sitl, embedded, fabric;  ///< the latter two: with the real processes, on this ledger
  InMode shim;                    ///< with the real processes, and drones behind the shim
};
KindModes modes_of(const FaultKind& kind);

/// "sitl, real", "real: `agent kill`", "refused: why" ...: the modes in words.
std::string modes_text(const KindModes& modes);

/// JSON Schema (draft 7) of a fault script, for editors and other programs: its keys as the reader of scripts asks for
/// them, its faults, moments and rules as their tables have them. A script that parse_script() takes is valid; one that
/// is valid may still be wrong in what no schema can say, such as a drone that does not fly.
std::string script_schema();

}  // namespace ledgerline::hil
