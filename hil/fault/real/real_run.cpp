#include "hil/fault/real/real_run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "common/base/file.hpp"
#include "common/process/children.hpp"
#include "hil/fault/own_code.hpp"
#include "hil/fault/real/real_faults.hpp"
#include "hil/fault/real/real_script.hpp"
#include "hil/fault/real/replay.hpp"
#include "hil/fault/real/sdk_flight.hpp"
#include "hil/fault/script.hpp"
#include "hil/sitl/world_setup.hpp"

namespace ledgerline::hil {
namespace {

namespace fs = std::filesystem;

constexpr TimeNs watch_ns = 20 * ns_per_ms;
constexpr TimeNs start_timeout_ns = 180 * ns_per_s;  // Fabric's network comes up first
constexpr TimeNs ending_timeout_ns = 60 * ns_per_s;  // landing, and all processes' ends

class RealFlight {
 public:
  RealFlight(const Script& script, std::uint64_t seed, const RealOptions& options)
      : script_(script),
        seed_(seed),
        options_(options),
        run_(options.directory + "/run"),
        live_(run_, script),
        faults_(script, {options.programs, options.directory, run_, "fly", options.stack}, live_, children_),
        program_(children_, options.own.program, options.directory) {}

  Result<RunResult> fly();

 private:
  Status start();
  Status watch();
  void ask_to_end(TimeNs now);
  Result<std::vector<std::string>> arguments() const;
  Result<Recording> recording() const;
  std::vector<std::string> crashes(const nlohmann::json& report) const;

  const Script& script_;
  std::uint64_t seed_;
  RealOptions options_;
  std::string run_;
  LiveObservation live_;
  SmallDisk disk_;  // outlives the programs that write there
  RealFaults faults_;
  OwnProgram program_;
  Children children_{{[this](const std::string& name, const std::string& line) {
    name == OwnProgram::name ? program_.add_line(line) : faults_.add_line(name, line);
  }}};
  bool over_ = true;
  TimeNs asked_to_end_ns_ = 0;
};

Status RealFlight::start() {
  if (auto made = make_flight_folder(options_.directory, {run_, options_.directory + "/result.json"}); !made)
    return made;
  const bool fills = std::any_of(script_.faults.begin(), script_.faults.end(),
                                 [](const Fault& fault) { return fault.acts.fills_disk; });
  if (fills) {
    if (auto mounted = disk_.mount(run_ + "/ledger"); !mounted) return mounted;
  }
  std::vector<std::string> command{options_.programs + "/ledgerline",  "fly", "--out", run_, "--json",
                                   options_.directory + "/result.json"};
  const auto more = arguments();
  if (!more) return more.error();
  command.insert(command.end(), more->begin(), more->end());
  return children_.start({"fly", std::move(command), options_.directory + "/fly.log", SIGTERM});
}

/// Courses of one's own go as files.
Result<std::vector<std::string>> RealFlight::arguments() const {
  std::vector<std::string> arguments = fly_arguments(script_, seed_, options_.stack);
  const WorldConfig& flight = script_.flight;
  if (!options_.own.controller.empty())
    arguments.insert(arguments.end(), {"--controller", fs::absolute(options_.own.controller).string()});
  const auto file_of = [&](const ground::Task& task, const std::string& name) -> Result<std::string> {
    const std::string file = fmt::format("{}/{}.csv", options_.directory, name);
    if (auto written = write_file(file, course_rows(task)); !written) return written.error();
    return file;
  };
  if (flight.manual) return arguments;
  if (!flight.waypoints.empty()) {
    const auto file = file_of(task_of(flight, 0), "course");
    if (!file) return file.error();
    arguments.insert(arguments.end(), {"--shape", *file});
  }
  for (const auto& [number, task] : flight.tasks) {
    const auto shape = task.waypoints.empty() ? Result<std::string>(ground::name_of(task.shape))
                                              : file_of(task, "course-" + drone_name(number));
    if (!shape) return shape.error();
    if (shape->find_first_of(" \t") != std::string::npos)
      return Error{fmt::format("{}: a [[task]] with waypoints needs an --out without blanks", *shape)};
    arguments.insert(arguments.end(),
                     {"--task", fmt::format("{} shape={} side={:g} speed={:g} laps={}", drone_name(number), *shape,
                                            task.side_m, task.speed_mps, task.laps)});
  }
  return arguments;
}

void RealFlight::ask_to_end(TimeNs now) {
  if (asked_to_end_ns_ != 0) return;
  asked_to_end_ns_ = now;
  children_.signal("fly", SIGINT);
}

Status RealFlight::watch() {
  const TimeNs start_until = monotonic_ns() + start_timeout_ns;
  while (children_.is_running("fly")) {
    children_.poll(watch_ns);
    live_.read();
    const TimeNs now = monotonic_ns();
    if (options_.should_stop()) ask_to_end(now);
    if (live_.begin_ns() == 0 && now > start_until)
      return Error{fmt::format("no flight within {:.0f} s: see {}", to_seconds(start_timeout_ns), options_.directory)};
    if (live_.begin_ns() == 0) continue;
    if (auto stepped = faults_.step(now); !stepped) return stepped;
    if (program_.has_command() && !program_.started()) {
      if (auto started = program_.start({}, topics_environment(script_.flight.drones)); !started) return started;
    } else if (program_.has_command() && !program_.is_running()) {
      ask_to_end(now);
    }
    const TimeNs late_ns = now - live_.begin_ns() - script_.limit_ns;
    if (late_ns > 0 && over_) {
      over_ = false;
      ask_to_end(now);
    }
    if (asked_to_end_ns_ > 0 && now - asked_to_end_ns_ > ending_timeout_ns) {
      children_.stop("fly", ending_timeout_ns);
      break;
    }
  }
  return done;
}

/// What ended though no fault did it. A death by SIGKILL is a fault's, as often as there was one; without RouDi link
/// and agent end by themselves on the ground.
std::vector<std::string> RealFlight::crashes(const nlohmann::json& report) const {
  std::map<std::string, int> killed;
  for (const RealFaults::Planned& planned : faults_.planned()) {
    if (planned.begun_ns == 0) continue;
    if (const auto program = planned.fault.acts.kills; !program.empty()) ++killed[std::string(program)];
  }
  std::vector<std::string> texts;
  for (const auto& end : report.value("ended_early", nlohmann::json::array())) {
    const std::string program = end.value("program", ""), how = end.value("how", "");
    if (how.starts_with("was ended by signal 9 ") && killed[program]-- > 0) continue;
    const bool without_roudi = killed.contains("roudi") && (program == "link" || program == "agent");
    if (without_roudi && how.starts_with("ended with exit code")) continue;
    texts.push_back(program + " " + how);
  }
  const auto parts = report.value("ledger", nlohmann::json::object()).value("restarts", nlohmann::json::object());
  for (const auto& [part, count] : parts.items()) {
    if (!faults_.killed_parts().contains(part))
      texts.push_back(fmt::format("{} ended {} times", part, count.get<int>()));
  }
  return texts;
}

Result<Recording> RealFlight::recording() const {
  Recording recording;
  for (const auto& entry : fs::directory_iterator(run_)) {
    const std::string name = entry.path().filename();
    if (!name.ends_with(".trace")) continue;
    std::vector<TraceRecord>* into = name.starts_with("link.")     ? &recording.link
                                     : name.starts_with("sim.")    ? &recording.sim
                                     : name.starts_with("ground.") ? &recording.ground
                                                                   : nullptr;
    if (!into) continue;
    auto records = read_trace(entry.path());
    if (!records) return records.error();
    if (into == &recording.link && !records->empty()) recording.link_restarts.push_back(records->front().t_ns);
    into->insert(into->end(), records->begin(), records->end());
  }
  std::erase_if(recording.link_restarts, [&](TimeNs t_ns) { return t_ns <= live_.begin_ns(); });
  const auto by_time = [](const TraceRecord& a, const TraceRecord& b) { return a.t_ns < b.t_ns; };
  for (auto* trace : {&recording.link, &recording.sim, &recording.ground}) {
    std::erase_if(*trace, [&](const TraceRecord& r) { return r.t_ns < live_.begin_ns(); });
    std::stable_sort(trace->begin(), trace->end(), by_time);
    if (!trace->empty()) recording.end_ns = std::max(recording.end_ns, trace->back().t_ns);
  }
  recording.begin_ns = live_.begin_ns();
  recording.over = over_;
  recording.faults = faults_.begun();
  bool died = false;  // link or agent, with its counts
  for (const RealFaults::Planned& planned : faults_.planned()) {
    if (planned.begun_ns == 0) continue;
    const Fault& fault = planned.fault;
    died = died || !fault.acts.kills.empty();
    if (!fault.acts.stops_link) continue;
    const auto back = std::find_if(recording.link.begin(), recording.link.end(),
                                   [&](const TraceRecord& r) { return r.t_ns > planned.begun_ns; });
    const TimeNs until = planned.ended_ns != 0          ? planned.ended_ns
                         : back == recording.link.end() ? recording.end_ns + 1
                                                        : back->t_ns;
    recording.link_away.emplace_back(planned.begun_ns, until);
  }
  const auto text = read_file(options_.directory + "/result.json");
  const auto report = text ? nlohmann::json::parse(*text, nullptr, false) : nlohmann::json();
  if (!report.is_object()) return Error{fmt::format("the flight left no figures: see {}", options_.directory)};
  recording.ok = report.value("ok", false);
  recording.why = report.contains("why") ? report["why"].get<std::string>() : "";
  recording.crashed = crashes(report);
  recording.lost_is_known = recording.ok && !died;
  for (const auto& drone : report["drones"]) {
    const auto& transitions = drone["transitions"];
    const std::uint64_t made = transitions["made"], on_ledger = transitions["on_ledger"], lost = transitions["lost"];
    if (lost > 0 || (recording.lost_is_known && on_ledger < made))
      recording.lost.push_back(
          fmt::format("{}: {} transitions made, {} on the ledger", drone["id"].get<std::string>(), made, on_ledger));
  }
  return recording;
}

Result<RunResult> RealFlight::fly() {
  if (auto started = start(); !started) return started.error();
  if (auto watched = watch(); !watched) {
    children_.signal("fly", SIGINT);
    children_.stop("fly", ending_timeout_ns);
    return watched.error();
  }
  faults_.end();
  program_.end();
  if (live_.begin_ns() == 0)
    return Error{
        fmt::format("the flight did not begin: {}\n{}", children_.how_it_ended("fly"), children_.log_tail("fly", 10))};
  const auto recorded = recording();
  if (!recorded) return recorded.error();
  RunResult result = check_recording(script_, seed_, *recorded);
  if (program_.has_command()) result.verdicts.push_back(program_.verdict(result.flown_ns));
  return result;
}

}  // namespace

Status make_flight_folder(const std::string& folder, const std::vector<std::string>& must_not_be_there) {
  std::error_code error;
  for (const std::string& old : must_not_be_there) {
    if (fs::exists(old, error))
      return Error{fmt::format("{} is of another flight: remove it, or give --out another folder", old)};
  }
  fs::create_directories(folder, error);
  if (error) return Error{fmt::format("cannot make {}: {}", folder, error.message())};
  return done;
}

Result<RunResult> run_really(const Script& script, std::uint64_t seed, const RealOptions& options) {
  if (script.kind == FlightKind::sdk) return fly_by_sdk(script, seed, options);
  if (auto possible = check_real(script, options.stack, options.own); !possible) return possible.error();
  return RealFlight(script, seed, options).fly();
}

}  // namespace ledgerline::hil
