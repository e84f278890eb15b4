#pragma once
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "onboard/link/core/settings.hpp"

/// The checks before drones take off, of each program that requests them: `ledgerline fly --deployment` by what link,
/// agent and the ledger say, `ledgerline tello preflight` by what drones, motion capture and the ledger themselves say.
/// Facts in, a verdict a line out. No I/O, no clock; any thread.
namespace ledgerline::fly {

/// Where a drone is. Without motion capture: as link estimates it by onboard odometry.
struct PoseFacts {
  double age_ms = 0;                 ///< of the newest, by its stamp on this computer's clock
  std::optional<double> rate_hz{};   ///< none: nobody counted
  std::optional<double> delay_ms{};  ///< the least from stamp to arrival; < 0: stamps of the future. None: not measured
  std::string frame{};               ///< as it names it; empty: not reported
  std::array<double, 3> position_m{};
};

struct LeaseFacts {
  enum class Holder { unknown, free, ours, for_us, other };  ///< for_us: another one holds it and lets us command
  Holder holder = Holder::unknown;
  bool enrolled = true;
  std::string holder_name{};            ///< MSP id and subject, printable
  std::vector<std::string> stoppers{};  ///< who has it stopped, likewise
};

struct DroneFacts {
  std::string name, address;
  std::string interface {};               ///< that it is behind; empty: the routing table says
  bool there = false;                     ///< it answers
  std::string serial{}, wanted_serial{};  ///< that it reported, and that it must report; empty: not reported, any
  std::optional<double> battery{};        ///< 0..1; none: not reported
  std::optional<double> temperature_c{};  ///< the hotter one that it reports; none: not reported
  std::optional<double> state_hz{};       ///< of its state text; none: nobody counted
  bool has_velocity = true;               ///< in its state text: what it flies by without motion capture
  std::optional<PoseFacts> pose{};        ///< none: none has come
  std::string refusal{};                  ///< what link has against a take-off: a FailsafeCause's name; empty: nothing
  std::string phase{};  ///< that link sees, where it is not on the ground; empty: it is, or nobody looked
  LeaseFacts lease{};
};

/// This computer's clock, as its kernel knows it (machine.hpp).
struct ClockFacts {
  bool known = false;         ///< the kernel reported it
  bool synchronised = false;  ///< by NTP or PTP
  double max_error_ms = 0;    ///< the kernel's own bound, where synchronised
};

struct LedgerFacts {
  enum class State { starts, reached, failed };
  State state = State::starts;  ///< starts: the flight starts it on this computer
  std::string what{};           ///< which it is, or why it was not reached
};

struct Facts {
  std::vector<DroneFacts> drones;
  link::LinkSettings link;   ///< fence and limits that drones fly with
  std::string pose_source;   ///< "mocap", or another one that link knows
  std::string pose_topic;    ///< of mocap, "{drone}" for the name
  bool stamps_count = true;  ///< of mocap: [pose] clock is not "arrival"
  bool enrols = true;        ///< the flight enrols drones that are not
  std::string path_beyond;   ///< why the path leaves the fence; empty: it does not, or is not known yet
  ClockFacts clock;
  LedgerFacts ledger;
};

enum class Verdict { ok, warn, bad };

struct Line {
  std::string drone;  ///< empty: of all of them
  std::string check;  ///< "battery"
  Verdict verdict = Verdict::ok;
  std::string what;
  std::string cure;  ///< empty where all is well
};

/// Each drone's lines in the order of the facts, then those of all. A drone that is not there has nothing else to
/// report than that, and its lease.
std::vector<Line> assess(const Facts& facts);

bool anything_bad(const std::vector<Line>& lines);
/// A line each, its cure below it.
std::string words(const std::vector<Line>& lines);
/// {"ok":false,"checks":[{"drone":"tello1"|null,"check":"battery","verdict":"bad","what":"...","cure":"..."|null}]}
std::string to_json(const std::vector<Line>& lines);

}  // namespace ledgerline::fly
