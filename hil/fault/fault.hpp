#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/rt/result.hpp"
#include "hil/world.hpp"

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
    line,  // effects of hil/impairment.hpp on a drone's datagrams or its mocap
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
    ledger_stall,
    ledger_restart,
    kill,
    stop,
    clock_jump,
    stop_drone,
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
  std::string effects;            ///< line
  Impairment impairment;          ///< the same
  SensorFault sensor;             ///< sensor
  std::vector<Process> ends;      ///< ledger_*: whose connection; kill, stop: who
  bool to = false, from = false;  ///< ledger_delay, ledger_hold
  std::optional<Distribution> delay;
  std::array<double, 3> vector{};  ///< mocap_offset, kick, wind
  double value = 0;  ///< battery, drain [0..1], mocap_noise [m], stop_drone (1: cut), burn (core), take_memory [bytes]
  std::string part{};  ///< kill_part: of Fabric's network, "peer1"; leader_part: the orderer that leads
  TimeNs time_ns = 0;  ///< clock_jump, mocap_every

  bool pushes() const;
  bool deafens() const;
  /// Whether it is over by itself as soon as it began.
  bool momentary() const;
};

/// `text` as in the class comment; what cannot be done in virtual time is refused with the reason, as is what a
/// connection cannot have. `for` and `at` are texts too; an empty `for` means until the end.
/// `real`: for a flight with the real processes, which has some faults more.
Result<Fault> parse_fault(std::string_view text, std::string_view at, std::string_view duration, bool real = false);

/// That its moment never came, in words.
std::string never_text(const Fault& fault);

/// Brings faults into a world when their moment comes, and takes them out again. One thread.
class FaultSchedule {
 public:
  /// The error names a drone that does not fly.
  static Result<FaultSchedule> create(std::vector<Fault> faults, const std::vector<DroneFacts>& drones);

  /// Before each step of the world.
  void step(VirtualWorld& world);

  struct Item {
    Fault fault;
    std::vector<std::size_t> drones;  ///< indices
    std::optional<TimeNs> reached_ns, begun_ns, ended_ns;
    bool active() const { return begun_ns && !ended_ns; }
  };
  const std::vector<Item>& items() const { return items_; }
  bool any_active() const;
  /// Faults that are not optional and whose moment has not come, in words.
  std::vector<std::string> never_begun() const;
  /// A process is dead, and its start is still to come: the run is not over.
  bool starts_to_come() const;
  /// When the first one began, the last one ended; nothing while there is none.
  std::optional<TimeNs> first_begun_ns() const;
  std::optional<TimeNs> last_ended_ns() const;  ///< nothing while one is to come or goes on; momentary: its beginning
  /// Of the first one that began; empty: none has.
  std::span<const std::size_t> first_drones() const;

  /// What a fault does to one drone, from its beginning until aftermath_ns behind its end.
  struct Effect {
    bool pushed = false;    ///< from outside, or broken (that for good): how fast and how high it gets says nothing
    bool deafened = false;  ///< what it is told may not get there: it flies on with the last rc it got, as a Tello does
  };
  Effect effect_on(std::size_t drone, TimeNs now) const;
  static constexpr TimeNs aftermath_ns = 5 * ns_per_s;

 private:
  explicit FaultSchedule(std::vector<Item> items) : items_(std::move(items)) {}
  void begin(VirtualWorld& world, Item& item);
  void end(VirtualWorld& world, Item& item);
  /// Anew from all that is active, since faults can lie upon each other: lines, sensors, mocap, drain, and what
  /// follows.
  void apply(VirtualWorld& world) const;
  void apply_processes(VirtualWorld& world) const;
  void apply_wind(VirtualWorld& world) const;

  std::vector<Item> items_;
};

}  // namespace ledgerline::hil
