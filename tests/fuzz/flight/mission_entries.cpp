#include "ground/mission/mission.hpp"
#include "ground/mission/run.hpp"
#include "tests/fuzz/entry.hpp"

/// Missions that somebody uploads, as JSON and as CSV, and what a ground kept of one. What is taken is checked against
/// drones that stand there, and read again from its canonical text.
namespace ledgerline::fuzz::mission_part {
namespace {

using namespace ground::mission;

std::vector<DroneNow> drones() {
  std::vector<DroneNow> drones(2);
  for (std::size_t i = 0; i < drones.size(); ++i) {
    drones[i].name = "tello" + std::to_string(i + 1);
    drones[i].seen = drones[i].on_ground = true;
    drones[i].at_m = Eigen::Vector3d(0, 2.0 * static_cast<double>(i), 0);
    drones[i].battery_share = 1;
  }
  return drones;
}

Outcome outcome_of_mission(const Result<Mission>& mission) {
  if (!mission) return refused(mission.error().message);
  const auto again = mission_from_json(canonical(*mission));
  if (!again || digest(*again) != digest(*mission)) return refused("");  // another mission than was approved
  CheckConfig config;
  config.fence.emplace();
  config.battery_endurance_s = 60;
  for (const Finding& finding : check(*mission, config, drones())) {
    if (finding.words.empty()) return refused("");
  }
  return accepted();
}

class JsonEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    return {
        R"({"name":"survey","drones":[{"drone":"tello1","waypoints":[{"x":1,"y":2,"z":1,"speed":0.5},{"x":2,"y":2}],)"
        R"("then":"land"},{"drone":"tello2","start":{"x":0,"y":2},"speed":0.4,"waypoints":[{"x":-1,"y":4}]}]})",
        R"({"name":"m","drones":[{"drone":"tello1","waypoints":[{"x":1,"y":2}]}]})"};
  }
  Outcome feed(std::string_view bytes) override { return outcome_of_mission(mission_from_json(bytes)); }
};

class CsvEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    return {"drone,x,y,z,speed,then\n# two\ntello1,1,2,1.5,0.5,\ntello2,-1,4,,1,hover\ntello1,2,2,,,land\n",
            "drone,x,y,z,speed\r\ntello1,0,0,,\r\ntello1,1,0,1,0.5\r\n"};
  }
  Outcome feed(std::string_view bytes) override { return outcome_of_mission(mission_from_csv(bytes, "survey")); }
};

/// Whatever was kept: without the approvals of the ledger nothing is ordered that goes anywhere.
class KeptEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    const std::string mission =
        R"("mission":{"name":"m","drones":[{"drone":"tello1","waypoints":[{"x":0,"y":0},{"x":1,"y":0}],"then":"land"}]}})";
    return {R"({"version":1,"phase":"flying","paused":false,"why":"",)"
            R"("drones":[{"drone":"tello1","leg":"halted","reached":1,"to_land":false}],)" +
                mission,
            R"({"version":1,"phase":"aborted","paused":false,"why":"enough",)"
            R"("drones":[{"drone":"tello1","leg":"landing","reached":2,"to_land":true}],)" +
                mission};
  }
  Outcome feed(std::string_view bytes) override {
    auto run = MissionRun::restore(bytes, {.after_restart = AfterRestart::go_on});
    if (!run) return refused(run.error().message);
    std::vector<DroneNow> now = drones();
    for (DroneNow& drone : now) {
      drone.on_ground = false;
      drone.phase = ground::GroundPhase::manual;
    }
    for (int i = 1; i <= 5; ++i) {
      for (const ground::PilotCommand& command : run->step(i * ns_per_s, now).commands) {
        if (command.takeoff || (command.order && command.order->kind == ground::PilotOrder::Kind::path))
          return refused("");
      }
    }
    return outcome_of(MissionRun::restore(run->saved(), {}));
  }
};

const Registration json({"mission.json", Kind::json, [] { return std::make_unique<JsonEntry>(); }});
const Registration csv({"mission.csv", Kind::text, [] { return std::make_unique<CsvEntry>(); }});
const Registration kept({"mission.kept", Kind::json, [] { return std::make_unique<KeptEntry>(); }});

}  // namespace
}  // namespace ledgerline::fuzz::mission_part
