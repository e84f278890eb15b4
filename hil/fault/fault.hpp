#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "hil/lines/distribution.hpp"
#include "hil/virtual/drone_lines.hpp"
#include "hil/virtual/facts.hpp"
#include "hil/virtual/ledger/ledger_port.hpp"
#include "hil/virtual/ledger/stoppers.hpp"

namespace ledgerline::hil {

/// A moment of a flight, as text: "5s" (of the run), "takeoff" (it leaves the ground), "flying", "path", "lap 2" (it
/// begins), "height 0.5", "landing", "landed"; each but the first with "+ 2s" behind it, if wanted. Of the fault's
/// drone; of the first one that gets there where the fault is no drone's.
struct Trigger {
  enum class Kind : std::uint8_t { time, takeoff, flying, path, lap, height, landing, landed };
  Kind kind = Kind::time;
  double value = 0;                                         ///< the lap's number; the height [m]
  TimeNs after_ns = 0;                                      ///< time: the moment itself
  bool reached(TimeNs now, const DroneFacts& drone) const;  ///< without `after_ns`; not for time
};
Result<Trigger> parse_trigger(std::string_view text);

inline constexpr std::string_view leader_part = "orderer leader";

/// One fault as it is written: where and what, e.g. "drone tello1 to delay 200ms". docs/faults.md lists all of them.
struct Fault {
  enum class What : std::uint8_t {
    line,  // effects of hil/lines/impairment.hpp on a drone's datagrams or its mocap
    sensor,
    mocap_frozen,
    mocap_offset,
    mocap_noise,
    mocap_every,
    reboot,
    battery,
    drain,
    propeller,
    kick,
    wind,
    ledger_delay,
    ledger_hold,  // of one process' connection: to and from
    ledger_cut,
    ledger_stale,
    ledger_lie,
    relay,  // a peer that has its key and says what it likes
    ledger_stall,
    ledger_restart,
    kill,
    stop,
    end,  // SIGTERM to link
    clock_jump,
    stop_drone,
    slip,
    kill_part,  // with the real processes alone, as what follows
    kill_roudi,
    burn,  // computing on a core
    take_memory,
    fill_disk,  // the ledger's
  };
  std::string text;
  std::string at = "path";  ///< as written
  Trigger trigger{Trigger::Kind::path, 0, 0};
  TimeNs for_ns = 0;      ///< 0: until the flight's end
  bool optional = false;  ///< its moment may never come; otherwise a run without it has not held

  What what{};
  std::string drone;              ///< empty: every drone
  std::vector<LineAt> lines;      ///< line
  Impairment impairment;          ///< line
  SensorFault sensor;             ///< sensor
  std::vector<Process> ends;      ///< ledger_*: whose connection; kill, stop: who
  bool to = false, from = false;  ///< ledger_delay, ledger_hold
  Lie lie = Lie::none;            ///< ledger_lie
  RelayLie relay = RelayLie::none;
  Slip slip = Slip::none;
  std::optional<Distribution> delay;
  std::array<double, 3> vector{};  ///< mocap_offset, kick, wind
  double value = 0;   ///< relay (1: clients compare), battery, drain [0..1], mocap_noise [m], burn (core), take_memory
                      ///< [bytes]
  Stopper stopper{};  ///< stop_drone, as the next one
  StopWord stop_word{};
  std::string part{};  ///< kill_part: of Fabric's network, "peer1"; leader_part: the orderer that leads
  TimeNs time_ns = 0;  ///< clock_jump, mocap_every

  bool pushes() const;
  /// What the drone is told may not get there.
  bool deafens() const;
  /// Nobody tells it anything, until link runs again.
  bool silences() const;
  /// Whether it is over by itself as soon as it began.
  bool momentary() const;
};

/// `text` as in the class comment; what cannot be done in virtual time is refused with the reason, as is what a
/// connection cannot have. `for` and `at` are texts too; an empty `for` means until the end.
/// `real`: for a flight with the real processes, which has some faults more.
Result<Fault> parse_fault(std::string_view text, std::string_view at, std::string_view duration, bool real = false);

/// That its moment never came, in words.
std::string never_text(const Fault& fault);

}  // namespace ledgerline::hil
