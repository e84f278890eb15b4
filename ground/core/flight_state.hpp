#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/fabric/sending/repeat.hpp"
#include "common/msg/stops.hpp"
#include "ground/core/flight.hpp"
#include "ground/core/manual.hpp"
#include "ledgerline.pb.h"

/// What FlightCore remembers; included by its .cpp files alone.
namespace ledgerline::ground {

constexpr TimeNs max_delay_ns = 4 * ns_per_s;
constexpr TimeNs overdue_ns = 2 * ns_per_s;       ///< a plan that agent may have refused because it was for too late
constexpr TimeNs state_every_ns = 5 * ns_per_ms;  ///< at most; a plan each

/// A plan on its way to the ledger.
struct PlannedCommand {
  DronePlan plan;  ///< sequence 0: not submitted yet
  TimeNs made_ns = 0;
  TimeNs made_stamp_ns = 0;  ///< the same moment on the drone's clock
  double progress_m = 0;
  std::uint64_t id = 0;  ///< for PathController::withdraw
};

struct FlightCore::Drone {
  explicit Drone(const FlightConfig& config) : manual(config.controller, config.cmd_timeout_ns) {}

  FlightDrone who;
  std::size_t index = 0;
  FlightStatus status;
  TimeNs entered_ns = 0;  ///< the phase; the ground's clock

  std::optional<crypto::IdentityName> owner, holder;
  std::optional<Control> record;  ///< the newest, whole: what control events have to follow from
  Control stoppers;               ///< who has it stopped; nothing else of the record
  std::uint64_t epoch = 0;
  std::uint64_t next_sequence = 1;

  StateSample state;
  bool has_state = false;
  bool fresh = false;      ///< the state came with this step
  bool wished = false;     ///< the pilot said something with this step
  TimeNs received_ns = 0;  ///< the ground's clock

  std::unique_ptr<PathController> controller;  ///< of a path
  motion::PlayoutMargin margin;
  motion::Window arrivals;       ///< from a plan's making until it was there; the drone's clock
  std::optional<Timing> timing;  ///< by arrivals
  std::uint64_t next_plan = 1;
  /// Of the newest plans submitted, as far back as one may be on its way: what states say of them belongs to these
  /// times.
  struct Made {
    std::uint64_t sequence = 0;
    TimeNs stamp_ns = 0;
  };
  std::array<Made, (max_delay_ns + overdue_ns) / state_every_ns + 1> made{};
  std::uint64_t applied_sequence = 0, arrived_sequence = 0;  ///< as the newest state had it
  bool slowed_said = false;
  ManualController manual;
  bool flew = false;
  TimeNs first_setpoint_ns = 0;  ///< of the newest plan; the drone's clock, as all below
  TimeNs settling_since_ns = 0;
  TimeNs path_since_ns = 0, lap_since_ns = 0, end_since_ns = 0;
  TimeNs last_at_ns = 0;
  double last_progress_m = 0;

  std::optional<PlannedCommand> pending;

  std::optional<DronesCall> stop;             ///< to be submitted, or under way
  std::optional<fabric::Repeat> stop_repeat;  ///< of that one
  std::uint64_t stop_id = 0;                  ///< 0: not under way
  TimeNs next_stop_ns = 0;
  TimeNs next_note_ns = 0;

  bool may_command(const crypto::IdentityName& self) const { return holder == self && !is_stopped(stoppers); }
  bool in_air_phase() const { return status.phase >= DronePhase::takeoff && status.phase <= DronePhase::manual; }
};

}  // namespace ledgerline::ground
