#include "hil/fault/real/real_faults.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <utility>

#include "common/process/usage.hpp"
#include "common/program/command_socket.hpp"
#include "hil/fault/real/real_script.hpp"
#include "hil/sitl/world_setup.hpp"

namespace ledgerline::hil {
namespace {

namespace fs = std::filesystem;
constexpr const char* small_disk = "size=256m";  // the ledger of a flight of some minutes

}  // namespace

std::vector<pid_t> descendants(pid_t parent, const std::string& program) {
  std::vector<pid_t> found;
  for (const pid_t pid : process_tree(parent)) {
    std::error_code gone;
    if (fs::read_symlink(fmt::format("/proc/{}/exe", pid), gone).filename() == program) found.push_back(pid);
  }
  return found;
}

CpuLoad::CpuLoad(int core)
    : thread_([](const std::stop_token& stop) {
        volatile std::uint64_t count = 0;
        while (!stop.stop_requested()) {
          for (int i = 0; i < 100'000; ++i) count = count + 1;
        }
      }) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(core), &set);
  pinned_ = ::pthread_setaffinity_np(thread_.native_handle(), sizeof set, &set) == 0;
}
SmallDisk::~SmallDisk() {
  if (!directory_.empty()) ::umount2(directory_.c_str(), MNT_DETACH);
}

Status SmallDisk::mount(const std::string& directory) {
  std::error_code error;
  fs::create_directories(directory, error);
  if (error) return Error{fmt::format("cannot make {}: {}", directory, error.message())};
  if (::unshare(CLONE_NEWNS) != 0 || ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
      ::mount("none", directory.c_str(), "tmpfs", 0, small_disk) != 0)
    return Error{
        fmt::format("`disk full` needs a file system of its own for the ledger: {}. Run it as root, or in a user "
                    "namespace (unshare -Urm)",
                    std::strerror(errno))};
  directory_ = directory;
  return done;
}

Status fill(const std::string& path) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  if (fd < 0) return Error{fmt::format("cannot make {}: {}", path, std::strerror(errno))};
  const std::string bytes(1 << 20, 'x');
  while (::write(fd, bytes.data(), bytes.size()) > 0) {
  }
  const int why = errno;
  ::close(fd);
  if (why != ENOSPC) return Error{fmt::format("cannot fill {}: {}", path, std::strerror(why))};
  return done;
}

namespace {

constexpr TimeNs task_timeout_ns = 20 * ns_per_s;

}  // namespace

RealFaults::RealFaults(const Script& script, Where where, const LiveObservation& live, Children& children)
    : where_(std::move(where)), drones_(script.flight.drones), live_(live), children_(children) {
  for (const Fault& fault : script.faults)
    planned_.push_back({fault, TriggerWatch(fault.trigger, fault.drone, live_.drones())});
}

Status RealFaults::step(TimeNs now) {
  if (auto stepped = step_faults(now); !stepped) return stepped;
  return run_tasks(now);
}

std::vector<Recording::Fault> RealFaults::begun() const {
  std::vector<Recording::Fault> faults;
  for (const Planned& planned : planned_) {
    if (planned.begun_ns != 0)
      faults.push_back(
          {planned.fault.text, planned.begun_ns, planned.ended_ns, planned.fault.acts.deafens, planned.fault.drone});
  }
  return faults;
}

void RealFaults::end() {
  cpu_loads_.clear();
  memory_.clear();
}

Status RealFaults::step_faults(TimeNs now) {
  for (Planned& planned : planned_) {
    const Fault& fault = planned.fault;
    if (!planned.begin_asked && planned.watch.is_due(now - live_.begin_ns(), live_.drones())) {
      planned.begin_asked = true;
      const auto begun = [&planned] {
        planned.begun_ns = monotonic_ns();
        if (planned.fault.acts.momentary) planned.ended_ns = planned.begun_ns;
      };
      const auto acts = acts_at_begin(fault, active(nullptr), drones_, where_.stack);
      if (auto acted = act(acts, true, begun); !acted)
        return Error{fmt::format("\"{}\": {}", fault.text, acted.error().message)};
    }
    const bool lasts = planned.begun_ns != 0 && planned.ended_ns == 0 && fault.for_ns > 0;
    if (lasts && !planned.stop_requested && now - planned.begun_ns >= fault.for_ns) {
      planned.stop_requested = true;
      const auto acts = acts_at_end(fault, active(&planned), drones_, where_.stack);
      if (auto acted = act(acts, false, [&planned] { planned.ended_ns = monotonic_ns(); }); !acted)
        return Error{fmt::format("the end of \"{}\": {}", fault.text, acted.error().message)};
    }
  }
  return done;
}

std::vector<Fault> RealFaults::active(const Planned* without) const {
  std::vector<Fault> faults;
  for (const Planned& planned : planned_) {
    if (planned.begin_asked && !planned.stop_requested && &planned != without) faults.push_back(planned.fault);
  }
  return faults;
}

Status RealFaults::act(const RealActs& acts, bool begin, const std::function<void()>& acted) {
  for (const std::string& command : acts.proxy) {
    const bool of_shim = where_.stack.shim && !command.starts_with("server ");
    const std::string socket = where_.run + (of_shim ? "/shim.sock" : "/faults.sock");
    if (auto sent = send_command(socket, command); !sent) return sent.error();
  }
  for (const auto& [program, signal] : acts.programs) {
    const auto pids = descendants(children_.pid(where_.parent), program);
    if (pids.empty()) return Error{program + " does not run"};
    for (const pid_t pid : pids) ::kill(pid, signal);
  }
  if (acts.burn_core >= 0 && begin) {
    auto load = std::make_unique<CpuLoad>(acts.burn_core);
    if (!load->pinned()) return Error{fmt::format("there is no core {} for us", acts.burn_core)};
    cpu_loads_[acts.burn_core] = std::move(load);
  } else if (acts.burn_core >= 0) {
    cpu_loads_.erase(acts.burn_core);
  }
  if (acts.take_bytes > 0 && begin) {
    if (available_memory() < acts.take_bytes + acts.take_bytes / 4)
      return Error{fmt::format("only {} MB are available: take less", available_memory() / 1'000'000)};
    memory_.emplace(acts.take_bytes, std::vector<char>(acts.take_bytes, 1));
  } else if (acts.take_bytes > 0) {
    (void)memory_.extract(acts.take_bytes);  // one of its size
  }
  const std::string filler = where_.run + "/ledger/filler";
  if (acts.fill_disk && begin) {
    if (auto filled = fill(filler); !filled) return filled;
  } else if (acts.fill_disk && ::unlink(filler.c_str()) != 0) {
    return Error{fmt::format("cannot remove {}: {}", filler, std::strerror(errno))};
  }
  if (!acts.parts.empty()) {
    signal_parts(acts.parts, monotonic_ns() + task_timeout_ns, acted);
  } else if (!acts.control.empty()) {
    std::vector<std::string> command{where_.programs + "/ledgerline", "control", "--config",
                                     where_.run + "/operator.toml"};
    command.insert(command.end(), acts.control.begin(), acts.control.end());
    tasks_.push_back({"control", std::move(command), [acted](const std::string&) {
                        acted();
                        return done;
                      }});
  } else {
    acted();
  }
  return done;
}

/// One after the other; the first one's answer is taken when it is there.
Status RealFaults::run_tasks(TimeNs now) {
  if (tasks_.empty()) return done;
  Task& task = tasks_.front();
  const std::string& name = task.name;
  if (task.until_ns == 0) {
    task.until_ns = now + task_timeout_ns;
    lines_[name].clear();
    return children_.start({name, task.command, where_.directory + "/" + name + ".log", SIGKILL});
  }
  if (children_.is_running(name)) {
    if (now < task.until_ns) return done;
    return Error{fmt::format("{} has not ended within {:.0f} s", name, to_seconds(task_timeout_ns))};
  }
  if (!children_.has_succeeded(name))
    return Error{fmt::format("{} {}: {}", name, children_.how_it_ended(name), children_.log_tail(name, 3))};
  const auto then = std::move(task.then);
  tasks_.pop_front();
  return then(lines_[name]);
}

/// Asks the network who they are, again while no orderer leads.
void RealFaults::signal_parts(const std::vector<std::pair<std::string, int>>& parts, TimeNs until,
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
  tasks_.push_back(
      {"fabric-status", {where_.programs + "/ledgerline", "fabric", "status", "--dir", where_.run + "/ledger"}, then});
}

namespace {

// For triggers: there is no link to say it.
LinkPhase phase_by_truth(const DroneObservation& drone) {
  if (on_course(drone.truth)) return LinkPhase::flying;
  if (!on_ground(drone.truth)) return drone.phase;
  return is_in_flight(drone.phase) || drone.phase == LinkPhase::landed ? LinkPhase::landed : LinkPhase::on_ground;
}

}  // namespace

std::vector<TraceRecord> GrowingTrace::read_new() {
  struct stat file {};
  if (::stat(path_.c_str(), &file) != 0) return {};
  if (!reader_ || file.st_ino != inode_) {
    auto opened = TraceReader::open(path_);
    if (!opened) return {};
    reader_ = std::make_unique<TraceReader>(std::move(*opened));
    inode_ = file.st_ino;
  }
  auto records = reader_->read_new();
  return records ? std::move(*records) : std::vector<TraceRecord>{};
}

LiveObservation::LiveObservation(const std::string& run, const Script& script)
    : sim_(run + "/sim.trace"),
      link_(run + "/link.trace"),
      ground_(run + "/ground.trace"),
      by_sdk_(script.kind == FlightKind::sdk),
      drones_(named_drones(script.flight.drones)) {
  for (const DroneObservation& drone : drones_) lap_m_.push_back(course_of(script.flight, drone.number, {}).length_m());
}

void LiveObservation::read() {
  for (const TraceRecord& r : sim_.read_new()) {
    if (by_sdk_ && begin_ns_ == 0) begin_ns_ = r.t_ns;
    if (DroneObservation* drone = of(r); drone && r.kind == TraceKind::truth) {
      drone->truth.in_flight = r.extra == 1;
      drone->truth.position_m = {r.v[0], r.v[1], r.v[2]};
      if (by_sdk_) drone->phase = phase_by_truth(*drone);
    }
  }
  for (const TraceRecord& r : link_.read_new()) {
    if (begin_ns_ == 0) begin_ns_ = r.t_ns;
    if (DroneObservation* drone = of(r); drone && r.kind == TraceKind::mode)
      drone->phase = static_cast<LinkPhase>(r.id);
  }
  for (const TraceRecord& r : ground_.read_new()) {
    DroneObservation* drone = of(r);
    if (!drone || r.kind != TraceKind::command_made || r.v[3] <= 0) continue;
    drone->ground_phase = ground::GroundPhase::path;
    drone->lap = 1 + static_cast<int>(r.v[3] / lap_m_[r.drone - 1u]);
  }
}

}  // namespace ledgerline::hil
