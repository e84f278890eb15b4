#pragma once
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "common/base/result.hpp"
#include "hil/fault/kinds/effects.hpp"
#include "hil/fault/kinds/real_acts.hpp"
#include "hil/fault/kinds/trigger.hpp"

namespace ledgerline::hil {

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
  /// Why it cannot be; empty: it can.
  std::function<std::string(const Fault&, const RealStack&)> not_real{};

  /// Why it would do nothing in such a flight; empty: it does something.
  std::function<std::string(const WorldConfig&)> idle_in{};

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
  struct ParsedWords {
    std::string text;                     ///< all of it
    std::string drone;                    ///< NAME; empty: every drone
    std::vector<std::string_view> words;  ///< what stands for choices and for other words in capitals
    std::string rest;                     ///< what stands for ...
  };
  Result<FaultActs> (*make)(const ParsedWords& said);
  bool real_only = false;  ///< simulated time has no such thing
};
std::span<const FaultKind> drone_faults(), sdk_faults(), sensing_faults(), ledger_faults(), process_faults(),
    machine_faults();
/// All of them, in one row of rows.
std::vector<const FaultKind*> fault_kinds();

/// `text` as in the table; what cannot be done in simulated time is refused with the reason, as is what a connection
/// cannot have. `for` and `at` are texts too; an empty `for` means until the end.
/// `real`: for a flight with the real processes, which has some faults more.
Result<Fault> parse_fault(std::string_view text, std::string_view at, std::string_view duration, bool real = false);
/// The row whose words these are; the error says which there are.
Result<const FaultKind*> kind_of(std::string_view text, bool real);

/// That its moment never came, in words.
std::string never_text(const Fault& fault);

}  // namespace ledgerline::hil
