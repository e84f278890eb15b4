#include "tools/launcher/launcher.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "sim/core/sensors.hpp"
#include "tools/checks/shell/host_probe.hpp"
#include "tools/command/runtime_folder.hpp"
#include "tools/launcher/machine.hpp"
#include "tools/launcher/page_access.hpp"
#include "tools/timing/usage.hpp"

namespace ledgerline::launcher {
namespace {

using nlohmann::json;

constexpr TimeNs watch_ns = 50 * ns_per_ms;
constexpr TimeNs usage_period_ns = ns_per_s;  // looking at all threads has its price
constexpr TimeNs memory_period_ns = 5 * ns_per_s;
constexpr TimeNs timeout_ns = 5 * ns_per_s, fabric_timeout_ns = 30 * ns_per_s;
constexpr TimeNs first_list_after_ns = 3 * ns_per_s;  // a drone has answered by then
constexpr TimeNs landing_timeout_ns = 17 * ns_per_s;  // ground gives itself 15 s, link 10 s
// Soon: without link a drone goes on with its last setpoint, and without agent it is not to come to landing. What dies
// faster than this does not fly.
constexpr Restarts::Limits onboard_limits{6, 15 * ns_per_s, 50 * ns_per_ms, 500 * ns_per_ms};

// That live through the flight.
std::vector<std::string> programs_of(const Options& options) {
  const std::string ledger = ledger_program(options), controller = controller_program(options);
  if (options.ledger == Ledger::none) return {"roudi", "sim", "link", controller};
  std::vector<std::string> names{"roudi", "link", "agent", controller};
  if (!ledger.empty()) names.push_back(ledger);
  if (!options.own) names.push_back("sim");
  if (options.endorser) names.push_back("endorser");
  if (options.proxy) names.push_back(proxy_name);
  return names;
}

/// What the programs of a flight use while it lasts, for its record and for ledgerline timing.
class UsageMeter {
 public:
  UsageMeter(const Children& children, const std::vector<std::string>& programs, RunRecord& record)
      : children_(children), record_(record) {
    for (const auto& name : programs) {
      usage_.programs[name] = children_.pid(name);
      cpu_[name] = cpu_at_begin_[name] = children_.cpu_seconds(name);
    }
    usage_.begin = usage_.end = timing::read_snapshot(usage_.programs);
  }
  const timing::UsageRecord& usage() const { return usage_; }

  /// Before the children are polled: of a process that is gone what was read here counts, one turn old at most.
  void read() {
    if (monotonic_ns() - usage_.end.t_ns >= usage_period_ns) {
      for (auto& [name, process] : usage_.programs) process = children_.pid(name);
      usage_.end = timing::read_snapshot(usage_.programs);
    }
    for (auto& [name, used_s] : cpu_) used_s = children_.cpu_seconds(name);
  }
  void record(TimeNs now_ns) {
    record_.end_ns = now_ns;
    const double flown_s = std::max(1e-3, to_seconds(now_ns - record_.begin_ns));
    for (const auto& [name, used_s] : cpu_)
      if (used_s >= cpu_at_begin_[name]) record_.cpu_percent[name] = 100 * (used_s - cpu_at_begin_[name]) / flown_s;
    if (now_ns < next_memory_ns_) return;
    next_memory_ns_ = now_ns + memory_period_ns;
    for (const auto& [name, process] : usage_.programs)
      if (const double mb = children_.memory_mb(name); mb > 0) record_.memory_mb[name] = mb;
  }

 private:
  const Children& children_;
  RunRecord& record_;
  timing::UsageRecord usage_;
  std::map<std::string, double> cpu_at_begin_, cpu_;
  TimeNs next_memory_ns_ = 0;
};

}  // namespace

Launcher::Launcher(Options options, RunFiles files, std::string programs, bool terminal,
                   const std::atomic<int>& interrupts)
    : options_(std::move(options)),
      files_(std::move(files)),
      interrupts_(interrupts),
      live_(drone_names(options_), terminal, monotonic_ns()),
      preflight_(options_),
      programs_(options_, files_, std::move(programs), interrupts,
                [this](const std::string& name, const json& message, const std::string& line) {
                  on_line(name, message, line);
                }),
      ledger_(options_, files_, programs_, preflight_, live_),
      controller_(controller_program(options_)),
      runtime_folder_(runtime_folder(environment_variable("XDG_RUNTIME_DIR"), environment_variable("HOME"))),
      all_programs_(programs_of(options_)) {
  // Without a ledger the controller is link's other end; a flight does not outlive it.
  for (const char* name : {"roudi", "link", "agent"}) {
    if (options_.ledger == Ledger::none) break;
    onboard_.push_back({name, Restarts(onboard_limits, static_cast<std::uint64_t>(realtime_ns()) + onboard_.size())});
  }
  // With the page ground is restarted, too.
  if (options_.watch && options_.manual)
    onboard_.push_back({controller_, Restarts(onboard_limits, static_cast<std::uint64_t>(realtime_ns()))});
}

void Launcher::on_line(const std::string& name, const json& message, const std::string& line) {
  if (message.value("ready", json()) == true) {
    if (const json page = message.value("page", json()); page.is_string()) show_page(page);
  } else if (name == records_program) {
    ledger_.set_records(line);
  } else if (name == "roudi") {
    const json leaked = message.value("leaked", json());
    if (leaked.is_number_unsigned()) chunks_leaked_ = leaked > 0;
  } else {
    if (name == "link") preflight_.on_status(line);
    live_.on_status(line);
  }
}

// Prints the token on the terminal only; it is never logged.
void Launcher::show_page(const std::string& url) {
  auto token = read_file(files_.page_token());
  if (!token) {
    live_.print(fmt::format("The page: {}, but its token cannot be read: {}", url, token.error().message));
    return;
  }
  while (token->ends_with('\n')) token->pop_back();
  const std::string page = fmt::format("{}/#token={}", url, *token);
  live_.print("The page: " + page);
  if (!options_.listen.empty()) show_access_of_others(page);
  const Status linked = link_station(runtime_folder_, files_.config(controller_));
  live_.print(fmt::format("By commands: {}export LEDGERLINE_STATION={} LEDGERLINE_TOKEN_FILE={}{}",
                          linked ? "ledgerline drones; from elsewhere: " : "", url, files_.page_token(),
                          options_.listen.empty() ? "" : " LEDGERLINE_CA=" + files_.in("page-ca.pem")));
  if (!std::exchange(options_.open, false)) return;  // a ground that comes back has its page open
  if (const Status opened = open_in_browser(page, files_.in("open.html")); !opened)
    live_.print("Open the page yourself: " + opened.error().message);
}

void Launcher::show_access_of_others(const std::string& page) {
  const auto pem = read_file(files_.in("page.pem"));
  const auto shown = pem ? fingerprint(*pem) : Result<std::string>(pem.error());
  if (shown)
    live_.print("A browser does not know this page's certificate. Go on if it shows this fingerprint (SHA-256):\n  " +
                *shown);
  const auto code = qr_code(page);
  if (code && ::isatty(STDERR_FILENO) == 1) live_.print(*code);
}

void Launcher::record_early_end(const std::string& name) {
  if (!programs_.has_succeeded(name)) record_.ended_early.emplace_back(name, programs_.how_it_ended(name));
}

Status Launcher::start_all() {
  if (auto s = programs_.start("roudi", {"--summary", files_.summary("roudi")}); !s) return s;
  if (options_.ledger == Ledger::none) return start_local();
  std::vector<std::string> first{"roudi"};
  if (!ledger_.program().empty()) {
    if (auto s = ledger_.start(); !s) return s;
    first.push_back(ledger_.program());
  }
  if (!options_.own) {
    if (auto s = start_sim(); !s) return s;
    first.push_back("sim");
  }
  if (auto s = programs_.wait_ready(first); !s) return s;
  if (auto s = ledger_.prepare(); !s) return s;
  for (const char* name : {"link", "agent", "ground"}) {
    if (options_.own && name == controller_) {
      if (auto s = wait_for_drones(); !s) return s;
    }
    if (auto s = programs_.start(name, {"--config", files_.config(name)}); !s) return s;
  }
  return programs_.wait_ready({"link", "agent", "ground"});
}

// Nothing takes off before ground is there.
Status Launcher::wait_for_drones() {
  if (auto s = programs_.wait_ready({"link", "agent"}); !s) return s;
  preflight_.set_clock(checks::probe_clock());
  const TimeNs limit_ns = options_.own->flight.wait_ns;
  const TimeNs until_ns = monotonic_ns() + limit_ns;
  const TimeNs answered_ns = monotonic_ns() + first_list_after_ns;
  TimeNs list_at_ns = answered_ns;
  for (Status ready = preflight_.ready(); !ready; ready = preflight_.ready()) {
    if (auto s = programs_.check(); !s) return s;
    const bool can_wait = monotonic_ns() <= answered_ns || preflight_.can_become_ready();
    if (!can_wait || monotonic_ns() > until_ns) {
      live_.print(preflight_.list());
      const std::string waited = can_wait ? fmt::format(" after {:.0f} s", to_seconds(limit_ns)) : "";
      return Error{fmt::format("not ready{}: {}", waited, ready.error().message)};
    }
    if (monotonic_ns() > list_at_ns) {
      list_at_ns = until_ns;  // once
      live_.print(preflight_.list() +
                  fmt::format("Waiting for what is broken, {:.0f} s at most", to_seconds(limit_ns)));
    }
    programs_.poll(watch_ns);
  }
  live_.print(preflight_.list());
  return preflight_.path_fits();
}

Status Launcher::start_local() {
  if (auto s = start_sim(); !s) return s;
  if (auto s = programs_.wait_ready({"roudi", "sim"}); !s) return s;
  if (auto s = write_local_configs(files_, options_); !s) return s;
  for (const std::string& name : {std::string("link"), controller_}) {
    if (auto s = programs_.start(name, {"--config", files_.config(name)}); !s) return s;
  }
  return programs_.wait_ready({"link", controller_});
}

Status Launcher::start_sim() {
  if (auto s = write_sim_config(files_, options_); !s) return s;
  std::vector<std::string> arguments{
      "--config",  files_.config("sim"),          "--drones",   std::to_string(options_.drones),
      "--seed",    std::to_string(options_.seed), "--trace",    files_.trace("sim"),
      "--summary", files_.summary("sim"),         "--mocap-hz", uses_mocap(options_) ? "100" : "0"};
  if (!options_.pads.empty()) arguments.insert(arguments.end(), {"--pads", sim::pads_text(options_.pads)});
  if (!options_.shim) return programs_.start("sim", arguments);
  arguments.insert(arguments.begin(), {"shim", "--memory", shim_memory(files_), "--faults", files_.in("shim.sock")});
  return programs_.start("sim", arguments, "hil");
}

// For ledgerline timing; the flight does not depend on it.
void Launcher::write_usage(const timing::UsageRecord& usage) {
  const auto written = write_file(files_.in(timing::usage_file), timing::to_json(usage).dump() + "\n");
  if (!written) live_.print(written.error().message);
}

Status Launcher::fly() {
  const std::uint64_t ledger_before = ledger_.program().empty() ? 0 : bytes_below(files_.in("ledger/."));
  record_.begin_ns = monotonic_ns();
  if (options_.manual && !options_.watch)
    live_.print(
        fmt::format("Waiting for a pilot's ROS 2 messages: /{}/takeoff, cmd_vel, land (docs/ros2.md). Ctrl-C "
                    "lands what flies and ends the flight",
                    drone_name(options_, 1)));
  UsageMeter meter(programs_, all_programs_, record_);
  write_usage(meter.usage());
  int interrupts_seen = 0;
  Status result = done;
  for (bool flying = true; flying;) {
    meter.read();
    programs_.poll(watch_ns);
    const TimeNs now_ns = monotonic_ns();
    meter.record(now_ns);
    live_.show(now_ns);
    if (!programs_.is_running(controller_) && !is_controller_restarted()) {
      if (!programs_.has_succeeded(controller_)) result = Error{programs_.why_controller_ended()};
      // Its exit code says how the flight went.
      if (programs_.was_killed(controller_)) record_early_end(controller_);
      flying = false;
    }
    // Without a ledger nothing is started again: it is a reference, not a flight to be kept up.
    std::vector<std::string> given_up;
    if (options_.ledger == Ledger::none) given_up = {"link", "roudi"};
    if (!ledger_.program().empty()) given_up.push_back(ledger_.program());
    if (!options_.own) given_up.push_back("sim");
    if (options_.proxy) given_up.push_back(proxy_name);
    for (const auto& name : given_up) {
      if (programs_.is_running(name)) continue;
      record_early_end(name);
      if (result) result = Error{programs_.crash_of(name, "during the flight")};
    }
    if (options_.endorser && !endorser_gone_ && !programs_.is_running("endorser")) {
      endorser_gone_ = true;
      record_early_end("endorser");
      live_.print(fmt::format("endorser {}: the peer endorses in its place", programs_.how_it_ended("endorser")));
    }
    if (flying && result) result = supervise_onboard(now_ns);
    flying = flying && result;
    if (interrupts_ > interrupts_seen && flying) {
      interrupts_seen = interrupts_;
      if (SwitchService* switches = ledger_.switches()) switches->end();  // a drone must hear that it shall land
      programs_.signal(controller_, SIGTERM);
      flying = !programs_.is_impatient();
      if (flying) live_.print("Landing all drones (once more Ctrl-C: do not wait for them)");
      if (!flying) result = Error{"interrupted twice: the drones were not awaited"};
    }
  }
  write_usage(meter.usage());
  const std::uint64_t ledger_after = ledger_.program().empty() ? 0 : bytes_below(files_.in("ledger/."));
  record_.ledger_grown_bytes = ledger_after > ledger_before ? ledger_after - ledger_before : 0;
  return result;
}

// One that was killed, and not asked to end.
bool Launcher::is_controller_restarted() const {
  return options_.watch && options_.manual && interrupts_ == 0 && programs_.was_killed(controller_);
}

// A process ends; or RouDi lost chunks with one that was killed, and nothing flies: a new one has them all.
Status Launcher::supervise_onboard(TimeNs now_ns) {
  if (chunks_leaked_ && !live_.anything_in_air()) recycle_shared_memory();
  for (Onboard& one : onboard_) {
    if (programs_.is_running(one.name)) continue;
    if (one.start_at_ns == 0) {
      if (one.name != "link" || !std::exchange(link_given_up_, false)) record_early_end(one.name);
      if (SwitchService* switches = ledger_.switches(); switches && one.name == controller_)
        switches->all_off();  // nobody can switch them now
      const auto at = one.restarts.ended(now_ns);
      if (!at) {
        const Restarts::Limits& limits = one.restarts.limits();
        return Error{programs_.crash_of(
            one.name, fmt::format("during the flight, more than {} times within {:.0f} s, and is given up",
                                  limits.max_restarts, to_seconds(limits.within)))};
      }
      one.start_at_ns = *at;
      live_.print(fmt::format("{} {} and is started again", one.name, programs_.how_it_ended(one.name)));
    }
    if (now_ns < one.start_at_ns || !may_start(one.name)) continue;
    one.start_at_ns = 0;
    if (auto status = start_again(one.name); !status) return status;
  }
  return done;
}

// In order. What link and agent share goes on without RouDi, so a drone in the air is not disturbed for a new one; on
// the ground both end by themselves. Where one of them has ended, it needs RouDi to come back.
bool Launcher::may_start(const std::string& name) const {
  if (name == "roudi") return !live_.anything_in_air() || !programs_.serves("link") || !programs_.serves("agent");
  return name == controller_ || (programs_.serves("roudi") && (name == "link" || programs_.serves("link")));
}

Status Launcher::start_again(const std::string& name) {
  programs_.expect_again(name);
  const std::uint64_t times = ++record_.restarts[name];
  if (name == "roudi") {
    chunks_leaked_ = false;
    // A link in the air that only a dead agent could hear would land; a new one goes on.
    if (live_.anything_in_air() && programs_.serves("link")) {
      programs_.expect_again("link");
      programs_.signal("link", SIGKILL);
      link_given_up_ = true;
    }
    return programs_.start(name, {"--summary", files_.summary(name)});
  }
  std::error_code error;  // it may have left none
  std::filesystem::rename(files_.trace(name), files_.trace(name, times), error);
  return programs_.start(name, {"--config", files_.config(name)});
}

void Launcher::recycle_shared_memory() {
  if (!programs_.is_running("roudi")) return;
  chunks_leaked_ = false;
  live_.print("RouDi lost shared memory with a process that was killed: it restarts, nothing is in the air");
  programs_.signal("roudi", SIGTERM);
}

// Ground first: it lands the drones through the ledger. Where that way is broken, link lands what flies, by itself.
void Launcher::stop_all(bool landed) {
  ledger_.end_switches();
  std::vector<std::string> order{controller_, "agent",           "link", proxy_name, "endorser",
                                 "sim",       ledger_.program(), "roudi"};
  if (!landed && !programs_.is_impatient() && programs_.is_running("link") &&
      (options_.own || programs_.is_running("sim")) && live_.anything_in_air()) {
    live_.print("Landing all drones");
    programs_.signal("link", SIGTERM);
    const TimeNs until_ns = monotonic_ns() + landing_timeout_ns;
    while (programs_.is_running("link") && monotonic_ns() < until_ns && !programs_.is_impatient()) {
      programs_.poll(watch_ns);
      live_.show(monotonic_ns());
    }
  }
  for (const auto& name : order) {
    if (name.empty() || !programs_.is_running(name)) continue;
    const TimeNs timeout = name == "fabric" ? fabric_timeout_ns : programs_.is_impatient() ? ns_per_s : timeout_ns;
    const bool in_time = programs_.stop(name, timeout);
    if (!in_time && !programs_.is_impatient()) {
      record_.ok = false;
      record_.why +=
          fmt::format("{}{} did not end when asked to and was killed", record_.why.empty() ? "" : "; ", name);
    } else if (in_time && landed && !programs_.has_succeeded(name)) {
      record_.ok = false;
      record_.why += (record_.why.empty() ? "" : "; ") + programs_.crash_of(name, "while ending");
    }
  }
}

RunRecord Launcher::run() {
  Status status = start_all();
  if (status) status = fly();
  record_.ok = status.ok();
  if (!status) record_.why = status.error().message;
  stop_all(programs_.has_succeeded(controller_));
  ledger_.give_back();
  if (!runtime_folder_.empty()) unlink_station(runtime_folder_, files_.config(controller_));
  if (!programs_.has_succeeded("roudi")) remove_roudi_leftovers();
  return record_;
}

}  // namespace ledgerline::launcher
