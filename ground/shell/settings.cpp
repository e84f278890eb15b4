#include "ground/shell/settings.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "common/msg/contract.hpp"
#include "common/rt/histogram.hpp"
#include "ground/core/flight_types.hpp"
#include "ground/plugin/plugin.hpp"
#include "ground/shell/path_file.hpp"

namespace ledgerline::ground {

using nlohmann::json;

namespace {

/// Those of the file that this key names.
std::vector<Waypoint> read_waypoints_of(Config& config, const Key& key) {
  auto waypoints = read_waypoints(config.text(key));
  if (waypoints) return std::move(*waypoints);
  config.wrong(key.name, "must be a file of waypoints: " + waypoints.error().message);
  return {};
}

void read_path(Config& config, FlightConfig& flight) {
  const std::string shape =
      config.choice({"flight.shape", "the path; manual: a pilot's ROS 2 messages; waypoints: your own path"},
                    {"square", "triangle", "x", "eight", "manual", "waypoints"}, "square");
  flight.manual = shape == "manual";
  if (shape == "waypoints" || config.is_describing()) {
    flight.waypoints =
        read_waypoints_of(config, {"flight.waypoints", "CSV file of x,y[,z[,speed]], for that shape alone",
                                   "required with shape = \"waypoints\""});
  } else if (!flight.manual) {
    flight.shape = *shape_from_name(shape);
  }
  flight.cmd_timeout_ns =
      config.integer({"flight.cmd_timeout_ms", "manual: a pilot's velocity holds so long, then the drone hovers"}, 300,
                     50, ManualController::max_timeout_ns / ns_per_ms) *
      ns_per_ms;
  flight.side_m = config.number({"flight.side_m", "of the square; other shapes are as wide"}, 1.5, 0.2, 50);
  flight.laps = static_cast<int>(config.integer({"flight.laps", "of the path, then land"}, 3, 1, 10'000));
  flight.seconds = config.number(
      {"flight.seconds", "fly so long instead of counting laps; manual: then land; 0: no limit"}, 0, 0, 86'400);
}

void read_controller(Config& config, ControllerConfig& controller) {
  controller.speed_mps = config.number({"flight.speed_mps", "along the path, where corners allow it"}, 0.5, 0.05, 8);
  controller.height_m = config.number({"flight.height_m", "of path and hover above the floor"}, 1.0, 0.3, 10);
  controller.predict = config.boolean(
      {"flight.predict", "steer from the state predicted for the command's arrival; false: from the newest"}, true);
  controller.ramp.start_mps =
      config.number({"flight.ramp_start_mps", "speed of a ramp's first lap; 0: no ramp"}, 0, 0, 8);
  controller.ramp.step_mps = config.number({"flight.ramp_step_mps", "by which each further lap is faster"}, 0, 0, 2);
  controller.full_scale_mps =
      config.number({"flight.full_scale_mps", "link's rc.full_scale_mps: the most that can be commanded"},
                    controller.full_scale_mps, 0.1, 20);
  controller.max_acceleration_mps2 =
      config.number({"flight.max_acceleration_mps2", "link's limits.acceleration_mps2: paths are planned within it"},
                    controller.max_acceleration_mps2, 0.1, 50);
  controller.pose_lost_ns =
      config.integer({"flight.pose_lost_ms", "link's failsafe.pose_lost_ms: with an older pose the path waits"},
                     controller.pose_lost_ns / ns_per_ms, 10, 10'000) *
      ns_per_ms;
  controller.lag_s = config.number({"flight.lag_s", "of the drone's answer to a velocity, until learned in flight"},
                                   controller.lag_s, 0.01, 2);
}

// A controller of one's own, in the place of ours.
void read_plugin(Config& config, FlightConfig& flight) {
  const std::string file =
      config.text({"flight.controller",
                   "shared library that steers along the path in place of ground's controller (docs/faults.md)"},
                  "");
  if (file.empty()) return;
  auto loaded = load_controller(file);
  if (!loaded) {
    config.wrong("flight.controller", "must be a controller: " + loaded.error().message);
  } else if (flight.manual) {
    config.wrong("flight.controller", "must not be there with shape = \"manual\", which has no path");
  } else {
    flight.follower = std::move(*loaded);
  }
}

// What one drone flies in its own way: the keys of [flight] again, in its table.
void read_task(Config& config, const std::string& key, FlightConfig& flight, FlightDrone& drone) {
  const std::string shape = config.choice({key + "shape", "its own path", "the flight's"},
                                          {"flight", "square", "triangle", "x", "eight", "waypoints"}, "flight");
  if (shape == "flight" && !config.is_describing()) return;
  if (flight.manual && !config.is_describing())
    config.wrong(key + "shape", "must not be there with [flight] shape = \"manual\", which has no path");
  Task task{flight.shape, flight.side_m, {}, flight.controller.speed_mps, flight.laps};
  if (shape == "waypoints" || config.is_describing()) {
    task.waypoints =
        read_waypoints_of(config, {key + "waypoints", "as flight.waypoints", "required with shape = \"waypoints\""});
  } else {
    task.shape = *shape_from_name(shape);
  }
  task.side_m = config.number({key + "side_m", "of its own path", "flight.side_m"}, task.side_m, 0.2, 50);
  task.speed_mps = config.number({key + "speed_mps", "on its own path", "flight.speed_mps"}, task.speed_mps, 0.05, 8);
  task.laps = static_cast<int>(config.integer({key + "laps", "of its own path", "flight.laps"}, task.laps, 1, 10'000));
  drone.task = std::move(task);
}

void read_requests(Config& config, FlightConfig& flight) {
  const std::string rule = config.choice(
      {"requests.rule",
       "another operator's request for a held drone, once older than after_s: hand_over gives it to the highest "
       "priority, in flight too; none: it is logged, and a person answers with `ledgerline control`"},
      {"none", "hand_over", "deny"}, "none");
  if (rule == "hand_over") flight.request_rule = RequestRule::hand_over;
  if (rule == "deny") flight.request_rule = RequestRule::deny;
  flight.request_after_ns =
      from_seconds(config.number({"requests.after_s", "for a person to answer first"}, 10, 0, 3600));
}

}  // namespace

FlightConfig flight_config(Config& config) {
  FlightConfig flight;
  read_requests(config, flight);
  read_path(config, flight);
  read_controller(config, flight.controller);
  read_plugin(config, flight);
  for (std::size_t i = 0; i < config.table_count({"drone", "one for each drone that is to fly"}); ++i) {
    const std::string key = fmt::format("drone.{}.", i);
    flight.drones.push_back({config.text({key + "name", "as enrolled on the ledger"}),
                             static_cast<DroneNumber>(
                                 config.integer({key + "number", "as in link.toml and agent.toml", "place in the file"},
                                                static_cast<int>(i) + 1, 1, max_drones))});
    const std::string& name = flight.drones.back().name;
    if (!name.empty() && !contract::is_drone_name(name)) config.wrong(key + "name", contract::drone_name_rule);
    read_task(config, key, flight, flight.drones.back());
  }
  return flight;
}

FlightConfig flight_of_channel(const FlightConfig& flight, const std::vector<std::size_t>& channel_of,
                               std::size_t channel) {
  FlightConfig own = flight;
  own.drones.clear();
  for (std::size_t i = 0; i < flight.drones.size(); ++i) {
    if (channel_of[i] == channel) own.drones.push_back(flight.drones[i]);
  }
  return own;
}

bridge::BridgeConfig read_bridge(Config& config, const std::vector<FlightDrone>& drones) {
  bridge::Host host;
  for (const FlightDrone& drone : drones) {
    for (const DroneTopic& topic : drone_topics) host.topics.push_back(topic_of(topic, drone.name));
    for (const PilotTopic& topic : pilot_topics) host.topics.push_back(topic_of(topic, drone.name));
  }
  return bridge::read_bridge(config, &host);
}

OutputSettings output_settings(Config& config) {
  OutputSettings output;
  output.trace = config.text({"output.trace", "file for `ledgerline timing` and the report (binary)"}, "");
  output.summary = config.text({"output.summary", "JSON file of all counts, written at the end"}, "");
  output.status_period_ns =
      config.integer({"output.status_period_ms", "between JSON status lines on standard output; 0: none"}, 0, 0,
                     60'000) *
      ns_per_ms;
  return output;
}

service::ServiceSettings service_settings(Config& config) {
  service::ServiceSettings settings;
  settings.listen = config.text({"service.listen",
                                 "ADDRESS:PORT of page and API (docs/station.md), without TLS of this computer alone "
                                 "(127.0.0.1:8800; port 0: any); none: no page"},
                                "");
  settings.token_file =
      config.text({"service.token_file", "of the page's token, made if missing: its readers may fly"}, "");
  settings.tls.certificate = config.text(
      {"service.tls_certificate",
       "PEM file of the page's certificate and its intermediates, read again when it changes; none: no TLS"},
      "");
  settings.tls.key = config.text({"service.tls_key", "PEM file of its key; as [ledger] private_key"}, "");
  settings.tls.authority = config.text(
      {"service.tls_client_ca",
       "PEM file of the authority of the certificates that browsers and programs must have; none: they need none"},
      "");
  settings.names = config.texts(
      {"service.names", "hosts and addresses of the page's URL, the shown one first, beside listen and localhost"},
      service::max_names);
  settings.operators =
      config.text({"service.operators",
                   "folder with an MSP folder for each operator, its key under a pass phrase: operators sign in at the "
                   "page and sign their requests (docs/station.md); none: ground's identity signs all"},
                  "");
  settings.session_idle_ns = from_seconds(
      config.number({"service.session_idle_s", "an operator silent for so long is signed out, and his drones land"},
                    900, 10, 86'400));
  settings.faults = config.text(
      {"service.faults",
       "Unix socket of a simulated flight's faults, for the page's switches; ./fly sets it (docs/station.md)"},
      "");
  if (settings.listen.empty()) return settings;
  for (const service::SettingError& error : service::errors_of(settings))
    config.wrong("service." + error.key, error.what);
  return settings;
}

service::MissionSettings mission_settings(Config& config) {
  service::MissionSettings settings;
  settings.folder =
      config.text({"mission.folder",
                   "of missions, so that a restarted ground goes on with them; none: what is in the air then hovers"},
                  "");
  mission::RunConfig& run = settings.run;
  run.required_approvals = static_cast<int>(config.integer(
      {"mission.approvals", "different signers that must have approved a mission before it starts"}, 1, 1, 2));
  settings.approvers =
      config.texts({"mission.approvers", "MSP ids whose members approve; none: our own organisation's"}, 16);
  settings.approval_s = std::lround(
      3600 *
      config.number({"mission.approval_hours",
                     "an approval ends after so long at most, and half of it at least; it is of this ground alone"},
                    24, 0.5, 8'760));
  const std::string on_loss = config.choice({"mission.on_loss", "of the others, when a drone of their mission is lost"},
                                            {"hover", "land", "go_on"}, "hover");
  run.on_loss = on_loss == "land"    ? mission::OnLoss::land
                : on_loss == "go_on" ? mission::OnLoss::go_on
                                     : mission::OnLoss::hover;
  const std::string after =
      config.choice({"mission.after_restart", "of a mission's drones that a restarted ground finds in the air"},
                    {"hover", "land", "go_on"}, "hover");
  run.after_restart = after == "land"    ? mission::AfterRestart::land
                      : after == "go_on" ? mission::AfterRestart::go_on
                                         : mission::AfterRestart::hover;
  mission::CheckConfig& check = settings.check;
  mission::Fence fence;
  const auto low = config.numbers(
      {"mission.fence_min_m", "corner of the box for missions and pilots' paths, as link's fence.min_m", "not checked"},
      3, {});
  const auto high = config.numbers({"mission.fence_max_m", "its other corner", "not checked"}, 3, {});
  if (low.size() != high.size()) config.wrong("mission.fence_min_m", "must be there with fence_max_m");
  if (low.size() == 3 && high.size() == 3) {
    std::copy(low.begin(), low.end(), fence.min_m.begin());
    std::copy(high.begin(), high.end(), fence.max_m.begin());
    check.fence = fence;
  }
  check.battery_endurance_s = config.number({"mission.battery_endurance_s", "in the air with a full battery"},
                                            check.battery_endurance_s, 60, 1'800);
  return settings;
}

PilotSettings pilot_settings(Config& config, bool has_operators, bool has_dds_security) {
  PilotSettings settings;
  settings.topics =
      config
          .boolean({"pilot.topics",
                    "pilots' ROS 2 topics are read: their writers fly, on loopback every user of this host",
                    "true; false with operators"})
          .value_or(!has_operators);
  const auto emergency = config.boolean(
      {"pilot.emergency", "`/<drone>/emergency`, too: motors off, in the air as well, without asking twice",
       "false; true with DDS Security"});
  settings.emergency = emergency.value_or(has_dds_security) && settings.topics;
  if (emergency.value_or(false) && !settings.topics)
    config.wrong("pilot.emergency", "must not be true without topics = true");
  return settings;
}

std::vector<const PilotTopic*> topics_read(const PilotSettings& settings) {
  std::vector<const PilotTopic*> read;
  for (const PilotTopic& topic : pilot_topics) {
    if (settings.topics && (!topic.cuts || settings.emergency)) read.push_back(&topic);
  }
  return read;
}

std::string checkpoint_path(Config& config) {
  return config.text({"output.checkpoint",
                      "file, of this ground alone, of the newest verified block: the next start refuses a peer with an "
                      "older chain or another one"},
                     "");
}

std::string status_line(const FlightView& flights, std::optional<std::int64_t> certificate_days) {
  json drones = json::array();
  for (std::size_t i = 0; i < flights.drones().size(); ++i) {
    const FlightStatus& status = flights.status(i);
    drones.push_back({{"name", flights.drones()[i].name},
                      {"phase", name_of(status.phase)},
                      {"lap", status.lap},
                      {"progress", status.progress}});
    if (flights.channels() > 1) drones.back()["channel"] = flights.channel_of(i);
  }
  json line = {{"drones", std::move(drones)}, {"why", flights.why()}};
  if (certificate_days) line["certificate_days"] = *certificate_days;
  return json{{"ground", std::move(line)}}.dump();
}

std::string summary(const FlightCore& core, const ShellCounters& shell) {
  json drones = json::array();
  for (std::size_t i = 0; i < core.drones().size(); ++i) {
    const FlightStatus& status = core.status(i);
    const PilotCounters& p = status.pilot;
    drones.push_back(
        {{"name", core.drones()[i].name},
         {"finished", status.finished},
         {"landed", status.phase == GroundPhase::landed},
         {"lap_s", status.lap_s},
         {"lap_m", status.lap_m},
         {"origin", status.origin_m},
         {"height_m", core.config().controller.height_m},
         {"alarms", status.alarms},
         {"ledger_untrusted", status.ledger_untrusted},
         {"states_received", status.states_received},
         {"commands_made", status.commands.made},
         {"commands_sent", status.commands.sent},
         {"commands_merged", status.commands.merged},
         {"commands_refused", status.commands.refused},
         {"path_ns", status.path_ns},
         {"limit_mps", std::isfinite(status.limit_mps) && status.limit_mps > 0 ? json(status.limit_mps) : json()},
         {"slowed_to_mps", status.slowed_to_mps ? json(*status.slowed_to_mps) : json()},
         {"response",
          {{"gain", status.response.gain}, {"lag_s", status.response.lag_s}, {"dead_s", status.response.dead_s}}},
         {"pilot",
          {{"velocities", p.velocities},
           {"replaced", p.replaced},
           {"bad_values", p.bad_values},
           {"not_flying", p.not_flying},
           {"malformed", p.malformed},
           {"late", p.late},
           {"refused", p.refused},
           {"dds_lost", shell.pilots[i].dds_lost},
           {"dds_refused", shell.pilots[i].dds_refused}}},
         {"why", status.why}});
  }
  const FlightTransactions& t = core.transactions();
  json all{{"drones", drones},
           {"transactions",
            {{"submitted", t.submitted},
             {"committed", t.committed},
             {"invalidated", t.invalidated},
             {"refused", t.refused},
             {"unavailable", t.unavailable},
             {"overloaded", t.overloaded}}},
           {"states_malformed", t.malformed},
           {"states_unverified", t.states_unverified},
           {"transactions_altered", t.altered},
           {"transactions_unverified", t.transactions_unverified},
           {"news_unpublished", shell.news_unpublished},
           {"ordered_blocks_confirmed_after_ms", shell.confirmed_after_ms},
           {"delay_ms", to_ms(core.delay_ns())},
           {"why", core.why()}};
  if (core.config().ledger) all["channel"] = core.config().where.channel;
  return all.dump(2);
}

std::string summary_of_all(const std::vector<std::string>& channels) {
  json all = json::array();
  for (const std::string& one : channels) all.push_back(json::parse(one));
  return json{{"channels", all}}.dump(2);
}

}  // namespace ledgerline::ground
