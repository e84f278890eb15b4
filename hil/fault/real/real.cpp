#include "hil/fault/real/real.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "common/base/file.hpp"
#include "common/process/children.hpp"
#include "hil/fault/real/live_facts.hpp"
#include "hil/fault/real/machine.hpp"
#include "hil/fault/real/replay.hpp"
#include "hil/proxy/fault_socket.hpp"
#include "hil/virtual/world_setup.hpp"

namespace ledgerline::hil {
namespace {

namespace fs = std::filesystem;

constexpr TimeNs watch_ns = 20 * ns_per_ms;
constexpr TimeNs start_patience_ns = 180 * ns_per_s;  // Fabric's network comes up first
constexpr TimeNs ending_patience_ns = 60 * ns_per_s;  // landing, and all processes' ends
constexpr TimeNs errand_patience_ns = 20 * ns_per_s;

struct Planned {
  Fault fault;
  std::vector<std::size_t> drones;
  TimeNs reached_ns = 0, begun_ns = 0, ended_ns = 0;  ///< CLOCK_MONOTONIC; 0: not yet
  bool begin_asked = false, stop_requested = false;   ///< an errand may still be on its way
};

/// Something that another program has to do or to say, while the flight is watched.
struct Errand {
  std::string name;
  std::vector<std::string> command;
  std::function<Status(const std::string& said)> then;
  TimeNs until_ns = 0;  ///< 0: not begun
};

class RealFlight {
 public:
  RealFlight(const Script& script, std::uint64_t seed, const RealOptions& options)
      : script_(script), seed_(seed), options_(options), run_(options.directory + "/run"), live_(run_, script) {
    for (const Fault& fault : script.faults) {
      Planned planned{fault, {}};
      for (std::size_t i = 0; i < live_.facts().size(); ++i) {
        if (fault.names(live_.facts()[i].name)) planned.drones.push_back(i);
      }
      planned_.push_back(std::move(planned));
    }
  }

  Result<RunResult> fly();

 private:
  Status start();
  Status watch();
  Status step_faults(TimeNs now);
  bool due(const Planned& planned, TimeNs now) const;
  std::vector<Fault> active(const Planned* without) const;
  Status act(const RealActs& acts, bool begin, const std::function<void()>& acted);
  void signal_parts(const std::vector<std::pair<std::string, int>>& parts, TimeNs until,
                    const std::function<void()>& signalled);
  Status run_errands(TimeNs now);
  Result<Recording> recording() const;
  std::vector<std::string> crashes(const nlohmann::json& report) const;

  const Script& script_;
  std::uint64_t seed_;
  RealOptions options_;
  std::string run_;
  LiveFacts live_;
  std::vector<Planned> planned_;
  std::map<std::string, std::string> lines_;  // of errands
  std::deque<Errand> errands_;                // at most two a fault
  std::set<std::string> killed_parts_;        // of Fabric's network
  SmallDisk disk_;                            // outlives the programs that write there
  Children children_{{[this](const std::string& name, const std::string& line) { lines_[name] += line + "\n"; }}};
  std::map<int, std::unique_ptr<Burner>> burners_;
  std::multimap<std::uint64_t, std::vector<char>> memory_;  // by size
  bool over_ = true;
};

Status RealFlight::start() {
  std::error_code error;
  fs::create_directories(options_.directory, error);
  if (error) return Error{fmt::format("cannot make {}: {}", options_.directory, error.message())};
  for (const std::string& old : {run_, options_.directory + "/result.json"}) {
    if (fs::exists(old, error))
      return Error{fmt::format("{} is of another flight: remove it, or give --out another folder", old)};
  }
  const bool fills = std::any_of(script_.faults.begin(), script_.faults.end(),
                                 [](const Fault& fault) { return fault.acts.fills_disk; });
  if (fills) {
    if (auto mounted = disk_.mount(run_ + "/ledger"); !mounted) return mounted;
  }
  std::vector<std::string> command{options_.programs + "/ledgerline-fly", "--out", run_, "--json",
                                   options_.directory + "/result.json"};
  const auto arguments = fly_arguments(script_, seed_, options_.ledger);
  command.insert(command.end(), arguments.begin(), arguments.end());
  return children_.start({"fly", std::move(command), options_.directory + "/fly.log", SIGTERM});
}

Status RealFlight::watch() {
  const TimeNs start_until = monotonic_ns() + start_patience_ns;
  TimeNs asked_to_end_ns = 0;
  while (children_.running("fly")) {
    children_.poll(watch_ns);
    live_.read();
    const TimeNs now = monotonic_ns();
    if (live_.begin_ns() == 0 && now > start_until)
      return Error{fmt::format("no flight within {:.0f} s: see {}", to_seconds(start_patience_ns), options_.directory)};
    if (live_.begin_ns() == 0) continue;
    if (auto stepped = step_faults(now); !stepped) return stepped;
    if (auto run = run_errands(now); !run) return run;
    const TimeNs late_ns = now - live_.begin_ns() - script_.limit_ns;
    if (late_ns > 0 && over_) {
      over_ = false;
      asked_to_end_ns = now;
      children_.signal("fly", SIGINT);
    }
    if (asked_to_end_ns > 0 && now - asked_to_end_ns > ending_patience_ns) {
      children_.stop("fly", ending_patience_ns);
      break;
    }
  }
  return done;
}

bool RealFlight::due(const Planned& planned, TimeNs now) const {
  const Trigger& trigger = planned.fault.trigger;
  if (trigger.kind == Trigger::Kind::time) return now - live_.begin_ns() >= trigger.after_ns;
  return planned.reached_ns != 0 && now - planned.reached_ns >= trigger.after_ns;
}

Status RealFlight::step_faults(TimeNs now) {
  for (Planned& planned : planned_) {
    const Fault& fault = planned.fault;
    if (planned.reached_ns == 0 && fault.trigger.kind != Trigger::Kind::time) {
      const bool reached = std::any_of(planned.drones.begin(), planned.drones.end(),
                                       [&](std::size_t i) { return fault.trigger.reached(now, live_.facts()[i]); });
      if (reached) planned.reached_ns = now;
    }
    if (!planned.begin_asked && due(planned, now)) {
      planned.begin_asked = true;
      const auto begun = [&planned] {
        planned.begun_ns = monotonic_ns();
        if (planned.fault.acts.momentary) planned.ended_ns = planned.begun_ns;
      };
      const auto acts = acts_at_begin(fault, active(nullptr), script_.flight.drones, options_.ledger);
      if (auto acted = act(acts, true, begun); !acted)
        return Error{fmt::format("\"{}\": {}", fault.text, acted.error().what)};
    }
    const bool lasts = planned.begun_ns != 0 && planned.ended_ns == 0 && fault.for_ns > 0;
    if (lasts && !planned.stop_requested && now - planned.begun_ns >= fault.for_ns) {
      planned.stop_requested = true;
      const auto acts = acts_at_end(fault, active(&planned), script_.flight.drones, options_.ledger);
      if (auto acted = act(acts, false, [&planned] { planned.ended_ns = monotonic_ns(); }); !acted)
        return Error{fmt::format("the end of \"{}\": {}", fault.text, acted.error().what)};
    }
  }
  return done;
}

std::vector<Fault> RealFlight::active(const Planned* without) const {
  std::vector<Fault> faults;
  for (const Planned& planned : planned_) {
    if (planned.begin_asked && !planned.stop_requested && &planned != without) faults.push_back(planned.fault);
  }
  return faults;
}

Status RealFlight::act(const RealActs& acts, bool begin, const std::function<void()>& acted) {
  for (const std::string& command : acts.proxy) {
    if (auto told = proxy::tell(run_ + "/faults.sock", command); !told) return told.error();
  }
  for (const auto& [program, signal] : acts.programs) {
    const auto pids = descendants(children_.pid("fly"), program);
    if (pids.empty()) return Error{program + " does not run"};
    for (const pid_t pid : pids) ::kill(pid, signal);
  }
  if (acts.burn_core >= 0 && begin) {
    auto burner = std::make_unique<Burner>(acts.burn_core);
    if (!burner->pinned()) return Error{fmt::format("there is no core {} for us", acts.burn_core)};
    burners_[acts.burn_core] = std::move(burner);
  } else if (acts.burn_core >= 0) {
    burners_.erase(acts.burn_core);
  }
  if (acts.take_bytes > 0 && begin) {
    if (available_memory() < acts.take_bytes + acts.take_bytes / 4)
      return Error{fmt::format("only {} MB are available: take less", available_memory() / 1'000'000)};
    memory_.emplace(acts.take_bytes, std::vector<char>(acts.take_bytes, 1));
  } else if (acts.take_bytes > 0) {
    (void)memory_.extract(acts.take_bytes);  // one of its size
  }
  const std::string filler = run_ + "/ledger/filler";
  if (acts.fill_disk && begin) {
    if (auto filled = fill(filler); !filled) return filled;
  } else if (acts.fill_disk && ::unlink(filler.c_str()) != 0) {
    return Error{fmt::format("cannot remove {}: {}", filler, std::strerror(errno))};
  }
  if (!acts.parts.empty()) {
    signal_parts(acts.parts, monotonic_ns() + errand_patience_ns, acted);
  } else if (!acts.control.empty()) {
    std::vector<std::string> command{options_.programs + "/ledgerline-control", "--config", run_ + "/operator.toml"};
    command.insert(command.end(), acts.control.begin(), acts.control.end());
    errands_.push_back({"control", std::move(command), [acted](const std::string&) {
                          acted();
                          return done;
                        }});
  } else {
    acted();
  }
  return done;
}

/// One after the other; the first one's answer is taken when it is there.
Status RealFlight::run_errands(TimeNs now) {
  if (errands_.empty()) return done;
  Errand& errand = errands_.front();
  const std::string& name = errand.name;
  if (errand.until_ns == 0) {
    errand.until_ns = now + errand_patience_ns;
    lines_[name].clear();
    return children_.start({name, errand.command, options_.directory + "/" + name + ".log", SIGKILL});
  }
  if (children_.running(name)) {
    if (now < errand.until_ns) return done;
    return Error{fmt::format("{} has not ended within {:.0f} s", name, to_seconds(errand_patience_ns))};
  }
  if (!children_.ended_well(name))
    return Error{fmt::format("{} {}: {}", name, children_.how_it_ended(name), children_.log_tail(name, 3))};
  const auto then = std::move(errand.then);
  errands_.pop_front();
  return then(lines_[name]);
}

/// Asks the network who they are, again while no orderer leads.
void RealFlight::signal_parts(const std::vector<std::pair<std::string, int>>& parts, TimeNs until,
                              const std::function<void()>& signalled) {
  const auto then = [this, parts, until, signalled](const std::string& said) -> Status {
    const auto status = nlohmann::json::parse(said, nullptr, false);
    const auto processes =
        status.is_object() ? status.value("processes", nlohmann::json::array()) : nlohmann::json::array();
    for (const auto& [part, signal] : parts) {
      const auto is_it = [&, name = std::string_view(part)](const nlohmann::json& process) {
        if (process.value("pid", 0) <= 0) return false;
        return name == leader_part ? process.contains("leads") && !process["leads"].empty()
                                   : process.value("name", "") == name;
      };
      const auto found = std::find_if(processes.begin(), processes.end(), is_it);
      if (found == processes.end()) {
        if (part != leader_part || monotonic_ns() > until) return Error{part + " does not run"};
        signal_parts(parts, until, signalled);
        return done;
      }
      if (signal == SIGKILL) killed_parts_.insert((*found)["name"].get<std::string>());
      ::kill((*found)["pid"].get<pid_t>(), signal);
    }
    signalled();
    return done;
  };
  errands_.push_back(
      {"fabric-status", {options_.programs + "/ledgerline-fabric", "status", "--dir", run_ + "/ledger"}, then});
}

/// What ended though no fault did it. A death by SIGKILL is a fault's, as often as there was one; without RouDi link
/// and agent end by themselves on the ground.
std::vector<std::string> RealFlight::crashes(const nlohmann::json& report) const {
  std::map<std::string, int> killed;
  for (const Planned& planned : planned_) {
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
    if (!killed_parts_.contains(part)) texts.push_back(fmt::format("{} ended {} times", part, count.get<int>()));
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
  bool died = false;  // link or agent, with its counts
  for (const Planned& planned : planned_) {
    if (planned.begun_ns == 0) continue;
    const Fault& fault = planned.fault;
    died = died || !fault.acts.kills.empty();
    recording.faults.push_back({fault.text, planned.begun_ns, planned.ended_ns, fault.acts.deafens, fault.drone});
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
    children_.stop("fly", ending_patience_ns);
    return watched.error();
  }
  burners_.clear();
  memory_.clear();
  if (live_.begin_ns() == 0)
    return Error{
        fmt::format("the flight did not begin: {}\n{}", children_.how_it_ended("fly"), children_.log_tail("fly", 10))};
  const auto recorded = recording();
  if (!recorded) return recorded.error();
  return judge_recording(script_, seed_, *recorded);
}

}  // namespace

Result<RunResult> run_really(const Script& script, std::uint64_t seed, const RealOptions& options) {
  if (auto possible = check_real(script, options.ledger); !possible) return possible.error();
  return RealFlight(script, seed, options).fly();
}

}  // namespace ledgerline::hil
