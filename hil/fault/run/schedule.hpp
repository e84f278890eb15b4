#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "hil/fault/checker/rule.hpp"
#include "hil/fault/kinds/fault.hpp"
#include "hil/sitl/world.hpp"

namespace ledgerline::hil {

/// Brings faults into a world when their moment comes, and takes them out again. One thread.
class FaultSchedule {
 public:
  /// The error names a drone that does not fly.
  static Result<FaultSchedule> create(std::vector<Fault> faults, const std::vector<DroneObservation>& drones);

  /// Before each step of the world.
  void step(SimulatedWorld& world);

  struct Item {
    Fault fault;
    TriggerWatch watch;
    std::optional<TimeNs> begun_ns{}, ended_ns{};
    bool active() const { return begun_ns && !ended_ns; }
  };
  const std::vector<Item>& items() const { return items_; }
  bool any_active() const;
  /// Faults that are not optional and whose moment has not come, in words.
  std::vector<std::string> never_begun() const;
  /// A process that a fault killed is still to be started again, so the run is not over.
  bool restart_pending() const;
  /// When the first one began, the last one ended; nothing while there is none.
  std::optional<TimeNs> first_begun_ns() const;
  std::optional<TimeNs> last_ended_ns() const;  ///< nothing while one is to come or goes on; momentary: its beginning
  /// Of the first one that began; empty: none has.
  std::span<const std::size_t> first_drones() const;

  /// What faults excuse one drone of, each from its beginning until aftermath_ns (of link: restart_ns) behind its end;
  /// what is broken or cut stays so.
  Moment::Excuse excuse_of(std::size_t drone, TimeNs now) const;
  static constexpr TimeNs aftermath_ns = 5 * ns_per_s;
  /// Of a link that died or stood still: it says zero in its first step, and a drone stops within a second.
  static constexpr TimeNs restart_ns = 1 * ns_per_s;

 private:
  FaultSchedule(std::vector<Item> items, std::size_t drones) : items_(std::move(items)), drone_count_(drones) {}
  void begin(SimulatedWorld& world, const Item& item) const;
  void end(SimulatedWorld& world, const Item& item) const;
  Effects effects() const;  ///< of all that are active

  std::vector<Item> items_;
  std::size_t drone_count_ = 0;
};

}  // namespace ledgerline::hil
