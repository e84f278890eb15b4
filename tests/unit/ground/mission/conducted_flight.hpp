#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "ground/mission/run.hpp"
#include "tests/unit/ground/mission/missions.hpp"

namespace ledgerline::ground::mission {

inline const crypto::IdentityName first_signer{"Org1MSP", "CN=User1"}, second_signer{"Org2MSP", "CN=User2"};

inline Mission two_drones() {
  return {"survey",
          {flown_by("tello1", {at(0, 0), at(1, 0), at(2, 0)}), flown_by("tello2", {at(0, 2), at(2, 2)}, true)}};
}

/// A flight of tello3, which has no part in it, tello1 and tello2, that obeys at once.
struct Flight {
  explicit Flight(RunConfig config_ = {}, Mission mission = two_drones())
      : config(config_), run(*MissionRun::make(std::move(mission), config)) {
    approve();
  }

  void approve() {
    run.set_approvals(std::vector<Approval>{{first_signer, run.digest()}, {second_signer, run.digest()}});
  }
  DroneNow& drone(const std::string& name) {
    return *std::find_if(drones.begin(), drones.end(), [&](const DroneNow& drone) { return drone.name == name; });
  }
  /// One step; what it orders is done at once, as FlightCore does.
  void step(double seconds = 0.1) {
    now += from_seconds(seconds);
    RunOutputs out = run.step(now, drones);
    changed = out.changed;
    if (run.awaits_check()) {  // after a restart
      run.resume_after_check(checked);
      RunOutputs more = run.step(now, drones);
      out.commands.insert(out.commands.end(), more.commands.begin(), more.commands.end());
      out.events.insert(out.events.end(), more.events.begin(), more.events.end());
    }
    commands = std::move(out.commands);
    events.insert(events.end(), out.events.begin(), out.events.end());
    for (const PilotCommand& command : commands) obey(command, drones.at(command.drone));
  }
  void obey(const PilotCommand& command, DroneNow& drone) {
    if (deaf == drone.name) return;
    if (command.takeoff) drone.phase = GroundPhase::takeoff;
    if (command.land) drone.phase = GroundPhase::landing;
    if (!command.order && !command.pause) return;
    drone.paused = command.pause;
    drone.phase = drone.paused ? GroundPhase::manual : GroundPhase::path;
    if (drone.paused) return;
    ordered[drone.name] = *command.order;
    drone.reached = 0;
    ++drone.paths;
  }
  void rises(const std::string& name) {
    drone(name).phase = GroundPhase::manual;
    drone(name).on_ground = false;
  }
  void ends_path(const std::string& name) {
    drone(name).reached = ordered.at(name).waypoints.size();
    drone(name).phase = ordered.at(name).land_behind ? GroundPhase::landing : GroundPhase::manual;
  }
  void lands(const std::string& name) {
    drone(name).phase = GroundPhase::landed;
    drone(name).on_ground = true;
  }
  void to_paths() {
    ASSERT_TRUE(run.start({}));
    step();
    rises("tello1");
    rises("tello2");
    step();
    ASSERT_EQ(run.phase(), RunPhase::to_start);
    step();
  }
  /// The ground station is started again: it knows what was kept, and has found no drone yet.
  void restart(AfterRestart rule) {
    config.after_restart = rule;
    auto restored = MissionRun::restore(run.saved(), config);
    ASSERT_TRUE(restored) << restored.error().message;
    run = std::move(*restored);
    ordered.clear();
    for (DroneNow& one : drones) {
      if (one.on_ground) one.phase = GroundPhase::waiting;
      if (!one.on_ground) one.phase = GroundPhase::waiting, one.paused = false, one.paths = 0, one.reached = 0;
    }
    approve();
  }
  std::vector<std::string> commanded() const {
    std::vector<std::string> words;
    for (const PilotCommand& command : commands) {
      const std::string what = command.takeoff                                 ? " takeoff"
                               : command.land                                  ? " land"
                               : command.pause                                 ? " pause"
                               : command.order->kind == PilotOrder::Kind::path ? " path"
                                                                               : " ?";
      words.push_back(drones.at(command.drone).name + what);
    }
    return words;
  }
  std::vector<std::string> reported() const {
    std::vector<std::string> words;
    for (const RunEvent& event : events) words.push_back(event.drone + (event.drone.empty() ? "" : ": ") + event.text);
    return words;
  }

  RunConfig config;
  Status checked = done;  ///< what check() comes to behind a restart
  MissionRun run;
  std::vector<DroneNow> drones{standing("tello3", 9, 9), standing("tello2", 0, 2), standing("tello1", 0, 0)};
  TimeNs now = ns_per_s;
  std::vector<PilotCommand> commands;
  std::vector<RunEvent> events;
  std::map<std::string, PilotOrder> ordered;
  std::string deaf;
  bool changed = false;
};

}  // namespace ledgerline::ground::mission
