#include "hil/fault/script.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <limits>

#include "common/base/file.hpp"
#include "common/config/config.hpp"
#include "common/msg/names.hpp"
#include "ground/shell/path_file.hpp"
#include "hil/fault/run/schedule.hpp"
#include "hil/sitl/world_setup.hpp"
#include "sim/core/sensors.hpp"

namespace ledgerline::hil {
namespace {

constexpr std::size_t max_rules = 50;
constexpr double usual_seconds = 30;  // of a manual flight

constexpr std::size_t max_waypoints = 500;

std::string row_of(const ground::Waypoint& waypoint) {
  std::string row = fmt::format("{},{}", waypoint.at_m.x(), waypoint.at_m.y());
  if (waypoint.height_m || waypoint.speed_mps)
    row += "," + (waypoint.height_m ? fmt::format("{}", *waypoint.height_m) : std::string());
  if (waypoint.speed_mps) row += fmt::format(",{}", *waypoint.speed_mps);
  return row;
}

/// Reads `shape` (a name, or a CSV file beside the script), `waypoints` (in the place of both: "x,y[,z[,speed]]" each),
/// `side_m`, `speed_mps` and `laps` below `prefix` ("flight."); what is not there stays as it is in `task`. `folder`:
/// of the script.
void read_course(Config& config, const std::string& prefix, const std::string& folder, ground::Task& task) {
  const std::string shape = config.text(
      Key(prefix + "shape", "square, triangle, x, eight, or a CSV file of x,y[,z[,speed]] rows beside the script")
          .like(R"(^(square|triangle|x|eight|.*[./].*)$)"),
      "");
  const auto rows = config.texts({prefix + "waypoints", "the same rows here, in the place of a shape"}, max_waypoints);
  task.side_m = config.number({prefix + "side_m", "of a shape"}, task.side_m, 0.3, 20);
  task.speed_mps = config.number({prefix + "speed_mps", "along the path"}, task.speed_mps, 0.05, 3);
  task.laps = static_cast<int>(config.integer({prefix + "laps", "around the path"}, task.laps, 1, 100));
  if (!shape.empty() && !rows.empty()) {
    config.wrong(prefix + "waypoints", "must not be there beside a shape");
    return;
  }
  if (!rows.empty()) {
    auto points = ground::motion::waypoints_from_csv(fmt::format("{}", fmt::join(rows, "\n")), "row");
    if (points) {
      task.waypoints = std::move(*points);
    } else {
      config.wrong(prefix + "waypoints", "must be rows \"x,y[,z[,speed]]\": " + points.error().message);
    }
    return;
  }
  if (shape.empty()) return;
  if (const auto known = ground::shape_from_name(shape)) {
    task.shape = *known;
    task.waypoints.clear();
    return;
  }
  auto course = ground::path_choice_from(shape.front() == '/' || folder.empty() ? shape : folder + "/" + shape);
  if (course) {
    task.waypoints = std::move(course->waypoints);
  } else {
    config.wrong(prefix + "shape", course.error().message);
  }
}

/// [flight]'s own course, then each [[task]]: `drone`, and the same keys. After the number of drones.
void read_tasks(Config& config, const std::string& folder, WorldConfig& flight) {
  ground::Task common = task_of(flight, 0);
  read_course(config, "flight.", folder, common);
  flight.shape = common.shape;
  flight.side_m = common.side_m;
  flight.waypoints = common.waypoints;
  flight.speed_mps = common.speed_mps;
  flight.laps = common.laps;
  for (std::size_t i = 0; i < config.table_count({"task", "what one drone flies in the place of [flight]'s course"});
       ++i) {
    const std::string prefix = fmt::format("task.{}.", i);
    const std::string name = config.text({prefix + "drone", "whose course it is"});
    ground::Task task = common;
    read_course(config, prefix, folder, task);
    int number = 1;
    while (number <= flight.drones && drone_name(number) != name) ++number;
    if (config.is_describing() || name.empty()) continue;
    if (number > flight.drones) {
      config.wrong(prefix + "drone",
                   fmt::format("must be one that flies here: {} to {}", drone_name(1), drone_name(flight.drones)));
    } else if (!flight.tasks.emplace(number, std::move(task)).second) {
      config.wrong(prefix + "drone", "must be another one: it has a task already");
    }
  }
}

/// The keys that differ from `usual`, a line each.
std::string course_text(const ground::Task& task, const ground::Task& usual) {
  std::string text;
  if (!task.waypoints.empty()) {
    text += "waypoints = [";
    for (const ground::Waypoint& waypoint : task.waypoints) text += fmt::format("\n  \"{}\",", row_of(waypoint));
    text += "\n]\n";
  } else if (task.shape != usual.shape || !usual.waypoints.empty()) {
    text += fmt::format("shape = \"{}\"\n", ground::name_of(task.shape));
  }
  if (task.side_m != usual.side_m) text += fmt::format("side_m = {}\n", task.side_m);
  if (task.speed_mps != usual.speed_mps) text += fmt::format("speed_mps = {}\n", task.speed_mps);
  if (task.laps != usual.laps) text += fmt::format("laps = {}\n", task.laps);
  return text;
}

/// Each [[task]].
std::string tasks_text(const WorldConfig& flight) {
  std::string text;
  const ground::Task common = task_of(flight, 0);
  for (const auto& [number, task] : flight.tasks)
    text += fmt::format("\n[[task]]\ndrone = \"{}\"\n", drone_name(number)) + course_text(task, common);
  return text;
}

/// That is flown at.
double greatest_height_m(const WorldConfig& flight) {
  const double usual_m = ground::ControllerConfig{}.height_m;
  double height_m = usual_m;
  for (int k = 1; k <= flight.drones; ++k) {
    for (const ground::Waypoint& waypoint : task_of(flight, k).waypoints)
      height_m = std::max(height_m, waypoint.height_m.value_or(usual_m));
  }
  return height_m;
}

// For a text in double quotes.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + "\"";
}

TimeNs duration(Config& config, const Key& key, TimeNs otherwise, TimeNs least, TimeNs most) {
  const std::string text = config.text(Key(key).like(R"(^\s*[0-9.]+\s*(ms|s)\s*$)"), "");
  if (text.empty()) return otherwise;
  const auto amount = parse_amount(text);
  if (!amount || amount->unit != Amount::Unit::time || amount->value < to_seconds(least) ||
      amount->value > to_seconds(most)) {
    config.wrong(key.name, fmt::format("must be a time from {:g} s to {:g} s, as in \"30 s\"", to_seconds(least),
                                       to_seconds(most)));
    return otherwise;
  }
  return from_seconds(amount->value);
}

constexpr std::array<std::string_view, 3> after_restart_names{"hover", "land", "go_on"};  // AfterRestart

void read_after_restart(Config& config, WorldConfig& flight) {
  const std::string name =
      config.choice({"flight.after_restart", "of a mission's drones that a restarted ground finds in the air"},
                    {"hover", "land", "go_on"}, "hover");
  const auto found = std::find(after_restart_names.begin(), after_restart_names.end(), name);
  if (found != after_restart_names.end())
    flight.after_restart = static_cast<ground::mission::AfterRestart>(found - after_restart_names.begin());
}

// The drones, and the floor below them.
void which_tello(Config& config, const std::string& folder, WorldConfig& flight) {
  flight.drawn_tello =
      config.choice({"flight.tello",
                     "the usual one, or each seed draws what nobody knows of a real one: latency, response, "
                     "drift at take-off, ground effect, downwash, heat"},
                    {"usual", "drawn"}, "usual") == "drawn";
  const std::string wifi = config.text({"flight.wifi",
                                        "every drone's radio: a recorded day beside the script, or `crowded`, a made "
                                        "one; the seed says where it begins"},
                                       "");
  if (!wifi.empty()) {
    auto recording = wifi == "crowded"
                         ? Result<std::shared_ptr<const LinkRecording>>(crowded_link())
                         : read_link_recording(wifi.front() == '/' || folder.empty() ? wifi : folder + "/" + wifi);
    if (recording)
      flight.wifi = Impairment::RecordedLink{*recording, wifi, 0};
    else
      config.wrong("flight.wifi", recording.error().message);
  }
  flight.battery = config.number({"flight.battery", "of every drone at the start, as a share"}, flight.battery, 0, 1);
  flight.keeps_rc = config.boolean(
      {"flight.keeps_rc", "a Tello that hears no rc flies on with the last one; false: it stops by itself after 0.5 s"},
      flight.keeps_rc);
  flight.command_counts =
      config.boolean({"flight.command_counts", "`command` is a sign of life for its own 15 s, as every other word"},
                     flight.command_counts);
  flight.yaw_deg =
      config.number({"flight.yaw_deg", "where drones look when they are switched on"}, flight.yaw_deg, -180, 180);
  if (auto pads = sim::parse_pads(config.text(
          {"flight.pads",
           "mission pads on the floor: 1:0:0,2:1.5:0:90 is 1 at (0 m, 0 m), 2 at (1.5 m, 0 m), turned by 90 degrees"},
          "")))
    flight.pads = std::move(*pads);
  else
    config.wrong("flight.pads", pads.error().message);
}

// Of every script that does not say another one.
void demand_height(Script& script) {
  constexpr double above_flight_m = 0.6;  // gusts, and what the drone overshoots when it stops a climb
  auto height = parse_rule(fmt::format("height below {:g} m", greatest_height_m(script.flight) + above_flight_m));
  if (!height ||
      std::any_of(script.must.begin(), script.must.end(), [&](const Rule& rule) { return rule.kind == height->kind; }))
    return;
  height->always = true;
  script.must.push_back(std::move(*height));
}

void read_flight(Config& config, const std::string& folder, Script& script) {
  WorldConfig& flight = script.flight;
  const std::string kind = config.choice(
      {"flight.kind", "who flies: ground along a path; a pilot's messages over topics; a client of the drone's SDK"},
      {"path", "manual", "sdk"}, "path");
  script.kind = kind == "manual" ? FlightKind::manual : kind == "sdk" ? FlightKind::sdk : FlightKind::path;
  flight.manual = script.kind == FlightKind::manual;
  flight.drones =
      static_cast<int>(config.integer({"flight.drones", "how many fly, tello1 first"}, flight.drones, 1, max_drones));
  read_tasks(config, folder, flight);
  flight.rate_hz = config.number({"flight.rate_hz", "states and commands a second"}, flight.rate_hz, 1, 200);
  flight.predict = config.boolean(
      {"flight.predict", "ground predicts where the drone will be when a command takes effect"}, flight.predict);
  flight.max_age_ns = duration(config, {"flight.max_age", "of a command: an older one is not flown"}, flight.max_age_ns,
                               100 * ns_per_ms, 10 * ns_per_s);
  flight.idle_evict_ns = duration(config, {"flight.idle_evict", "a holder on the ground may say nothing for so long"},
                                  flight.idle_evict_ns, ns_per_s, 86'400 * ns_per_s);
  flight.blocks =
      config.choice({"flight.blocks", "whose blocks agent and ground read: the peer's, or as they are ordered"},
                    {"peer", "ordered"}, "peer") == "ordered"
          ? fabric::BlockSource::ordered
          : fabric::BlockSource::peer;
  flight.pose = from_name<link::PoseSource>(config.choice({"flight.pose", "how a drone knows where it is"},
                                                          {"mocap", "tello", "pads", "mocap+tello"}, "mocap"))
                    .value_or(flight.pose);
  flight.calibrated = config.boolean(
      {"flight.calibrated", "link knows the scale, lag and bias of its drones' own velocities"}, flight.calibrated);
  flight.on_untrusted_ledger =
      from_name<link::OnUntrustedLedger>(
          config.choice({"flight.on_untrusted_ledger", "what link does while agent does not trust the ledger"},
                        {"ignore", "hold", "land"}, "ignore"))
          .value_or(flight.on_untrusted_ledger);
  which_tello(config, folder, flight);
  read_after_restart(config, flight);
  flight.room_m =
      config.number({"flight.room_m", "the fence's distance from the paths; below 0 its far sides cut through them"},
                    *flight.room_m, -10, 100);
  flight.batch_count =
      static_cast<std::size_t>(config.integer({"flight.batch_count", "transactions in a block, at most"}, 1, 1, 1'000));
  flight.batch_timeout_ns = duration(config, {"flight.batch_timeout", "a block is cut after so long"},
                                     flight.batch_timeout_ns, ns_per_ms, 10 * ns_per_s);
  script.limit_ns = duration(config, {"flight.limit", "a run that is not over by then is broken"}, script.limit_ns,
                             ns_per_s, 3600 * ns_per_s);
  flight.seconds =
      config.number({"flight.seconds", "manual: then the drones are landed, and it is over"}, usual_seconds, 1, 3600);
  if (flight.seconds != usual_seconds && !flight.manual)
    config.wrong("flight.seconds", "must not be there: it goes with kind = \"manual\"");
  script.pilot = read_pilot(config, flight.drones);
  if (!script.pilot.empty() && !flight.manual)
    config.wrong("pilot.0.do", "must not be there: a pilot goes with kind = \"manual\"");
}

/// Whether a moment can come in such a flight.
Status check_moment(const Trigger& trigger, const Script& script) {
  if (trigger.of_a_path() && script.kind != FlightKind::path)
    return Error{
        fmt::format("must be no moment of a path: in a flight of kind \"{}\" ground flies none", name_of(script.kind))};
  int laps = 0;
  for (int k = 1; k <= script.flight.drones; ++k) laps = std::max(laps, task_of(script.flight, k).laps);
  if (trigger.kind == Trigger::Kind::lap && trigger.value > laps)
    return Error{fmt::format("must be a lap that is flown: there {} {}", laps == 1 ? "is" : "are", laps)};
  return done;
}

void read_fault(Config& config, const std::string& key, const std::vector<DroneObservation>& drones, bool real,
                Script& script) {
  const bool on_path = script.kind == FlightKind::path;
  const std::string what = config.text({key + "what", "where and what goes wrong"}),
                    at = config.text({key + "at", "when it begins"}, on_path ? "path" : "takeoff"),
                    lasts = config.text({key + "for", "how long it lasts; left out: to the end"}, "");
  const bool optional =
      config.boolean({key + "optional", "its moment may never come; otherwise the run is then broken"}, false);
  if (config.is_describing()) return;
  bool is_right = true;
  const auto check = [&](const char* which, const Status& status) {
    if (!status) config.wrong(key + which, status.error().message);
    is_right = is_right && status.ok();
  };
  // Each key by itself, so that all that is wrong is said at once.
  if (const auto trigger = parse_trigger(at); !trigger)
    check("at", trigger.error());
  else
    check("at", check_moment(*trigger, script));
  if (!lasts.empty()) {
    const auto time = parse_fault_time(lasts);
    if (!time) check("for", time.error());
  }
  if (what.empty()) return;
  const auto begun = parse_fault(what, "", "", real);
  if (!begun) {
    check("what", begun.error());
  } else if (const auto tried = FaultSchedule::create({*begun}, drones); !tried) {
    check("what", tried.error());
  } else if (const Status works = begun->acts.check_flight(script.flight); !works) {
    check("what", Error{fmt::format("\"{}\" does nothing: {}", begun->text, works.error().message)});
  }
  if (!is_right) return;
  auto fault = parse_fault(what, at, lasts, real);
  if (!fault) {
    check("for", fault.error());  // each is right, but not with the other
    return;
  }
  fault->optional = optional;
  script.faults.push_back(std::move(*fault));
}

void read_rule(Config& config, const std::string& sentence, bool faults, Script& script) {
  auto rule = parse_rule(sentence);
  if (!rule) {
    config.wrong("must", rule.error().message);
    return;
  }
  if (rule->kind->needs_fault && !faults) {
    config.wrong("must", fmt::format("\"{}\" counts from a fault, and there is none", sentence));
    return;
  }
  const auto endless = std::find_if(script.faults.begin(), script.faults.end(),
                                    [](const Fault& fault) { return fault.for_ns == 0 && !fault.acts.momentary; });
  if (rule->kind->needs_fault_end && endless != script.faults.end()) {
    config.wrong("must", fmt::format("\"{}\" counts from the last fault's end, and \"{}\" never ends: give it a `for`",
                                     sentence, endless->text));
    return;
  }
  script.must.push_back(std::move(*rule));
}

}  // namespace

std::string_view name_of(FlightKind kind) { return enum_names<FlightKind>[static_cast<std::size_t>(kind)]; }

Script read_script(Config& config, const std::string& file, bool real) {
  Script script;
  script.name = std::filesystem::path(file).stem().string();
  script.title = config.text({"title", "one sentence: what happens"});
  constexpr std::int64_t max_seed = std::numeric_limits<std::int64_t>::max();
  if (const auto seed = config.integer({"seed", "it is flown with, unless --seed says another"}, 0, 1, max_seed);
      seed > 0)
    script.seed = seed;
  read_flight(config, std::filesystem::path(file).parent_path().string(), script);

  const std::size_t faults = config.table_count({"fault", "what goes wrong"});
  const std::vector<DroneObservation> drones = named_drones(script.flight.drones);
  for (std::size_t i = 0; i < faults; ++i) read_fault(config, fmt::format("fault.{}.", i), drones, real, script);
  for (const std::string& sentence : config.texts({"must", "what must hold, a sentence each"}, max_rules))
    read_rule(config, sentence, faults > 0, script);
  return script;
}

Result<Script> parse_script(std::string_view toml, const std::string& file, bool real) {
  auto config = Config::parse(toml, file);
  if (!config) return config.error();
  Script script = read_script(*config, file, real);
  if (auto status = config->finish(); !status) return status.error();
  demand_height(script);
  return script;
}

Result<Script> load_script(const std::string& path, bool real) {
  const auto text = read_file(path);
  if (!text) return text.error();
  return parse_script(*text, path, real);
}

std::string text_of(const Script& script) {
  const WorldConfig usual;
  const WorldConfig& f = script.flight;
  std::string text = fmt::format("title = {}\n", quoted(script.title));
  if (script.seed) text += fmt::format("seed = {}\n", *script.seed);
  text += "must = [";
  for (const Rule& rule : script.must) {
    if (!rule.always) text += fmt::format("\n  {},", quoted(rule.text));
  }
  text += text.ends_with('[') ? "]\n" : "\n]\n";
  text += "\n[flight]\n";
  if (script.kind != FlightKind::path) text += fmt::format("kind = \"{}\"\n", name_of(script.kind));
  if (f.manual && f.seconds != usual_seconds) text += fmt::format("seconds = {}\n", f.seconds);
  if (f.drones != usual.drones) text += fmt::format("drones = {}\n", f.drones);
  text += course_text(task_of(f, 0), task_of(usual, 0));
  if (f.rate_hz != usual.rate_hz) text += fmt::format("rate_hz = {}\n", f.rate_hz);
  if (f.predict != usual.predict) text += fmt::format("predict = {}\n", f.predict);
  if (f.max_age_ns != usual.max_age_ns) text += fmt::format("max_age = \"{:g} s\"\n", to_seconds(f.max_age_ns));
  if (f.idle_evict_ns != usual.idle_evict_ns)
    text += fmt::format("idle_evict = \"{:g} s\"\n", to_seconds(f.idle_evict_ns));
  if (f.blocks != usual.blocks) text += "blocks = \"ordered\"\n";
  if (f.pose != usual.pose) text += fmt::format("pose = \"{}\"\n", name(f.pose));
  if (f.calibrated != usual.calibrated) text += fmt::format("calibrated = {}\n", f.calibrated);
  if (f.on_untrusted_ledger != usual.on_untrusted_ledger)
    text += fmt::format("on_untrusted_ledger = \"{}\"\n", name(f.on_untrusted_ledger));
  if (f.after_restart != usual.after_restart)
    text += fmt::format("after_restart = \"{}\"\n", after_restart_names[static_cast<std::size_t>(f.after_restart)]);
  if (f.battery != usual.battery) text += fmt::format("battery = {}\n", f.battery);
  if (f.drawn_tello) text += "tello = \"drawn\"\n";
  if (f.wifi) text += fmt::format("wifi = {}\n", quoted(f.wifi->file));
  if (f.yaw_deg != usual.yaw_deg) text += fmt::format("yaw_deg = {}\n", f.yaw_deg);
  if (!f.pads.empty()) text += fmt::format("pads = {}\n", quoted(sim::pads_text(f.pads)));
  if (f.keeps_rc != usual.keeps_rc) text += fmt::format("keeps_rc = {}\n", f.keeps_rc);
  if (f.command_counts != usual.command_counts) text += fmt::format("command_counts = {}\n", f.command_counts);
  if (f.room_m != usual.room_m) text += fmt::format("room_m = {}\n", f.room_m.value_or(0));
  if (f.batch_count != usual.batch_count) text += fmt::format("batch_count = {}\n", f.batch_count);
  if (f.batch_timeout_ns != usual.batch_timeout_ns)
    text += fmt::format("batch_timeout = \"{} ms\"\n", to_ms(f.batch_timeout_ns));
  text += fmt::format("limit = \"{:g} s\"\n", to_seconds(script.limit_ns));
  text += tasks_text(f) + pilot_text(script.pilot);
  for (const Fault& fault : script.faults) {
    text += fmt::format("\n[[fault]]\nwhat = {}\nat = {}\n", quoted(fault.text), quoted(fault.at));
    if (fault.for_ns > 0) text += fmt::format("for = {}\n", quoted(time_text(fault.for_ns)));
    if (fault.optional) text += "optional = true\n";
  }
  return text;
}

std::string course_rows(const ground::Task& task) {
  std::string rows;
  for (const ground::Waypoint& waypoint : task.waypoints) rows += row_of(waypoint) + "\n";
  return rows;
}

}  // namespace ledgerline::hil
