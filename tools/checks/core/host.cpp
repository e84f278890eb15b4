#include "tools/checks/core/host.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace ledgerline::checks {
namespace {

// A log and a checkpoint fit; and an hour's trace of three drones.
constexpr std::uint64_t least_bytes = 64ULL << 20, good_bytes = 1ULL << 30;

bool is_ours(const std::string& program) { return program.empty() || program.starts_with("ledgerline"); }

// A service's folder has its user's name.
std::string user_of(const std::string& folder) {
  const std::string name = folder.substr(folder.rfind('/') + 1);
  return name.starts_with("ledgerline") ? name : "USER";
}

}  // namespace

Findings assess(const DirectoryInputs& inputs) {
  constexpr const char* check = "disk";
  if (inputs.read_only)
    return {flag(Problem::disk_read_only, check, inputs.path,
                 fmt::format("`mount -o remount,rw $(findmnt -n -o TARGET -T {})`; `dmesg` says whether the kernel did "
                             "it after errors: then replace the card or disk",
                             inputs.path))};
  if (!inputs.writable)
    return {flag(Problem::state_folder, check, inputs.path,
                 fmt::format("`install -d -o {} {}`, or run doctor as the user of the programs", user_of(inputs.path),
                             inputs.path))};
  if (!inputs.free_bytes) return {fine(check, inputs.path)};
  const std::string what = fmt::format("{}: {} MB free", inputs.path, *inputs.free_bytes >> 20);
  if (*inputs.free_bytes < least_bytes) return {flag(Problem::disk_full, check, what)};
  if (*inputs.free_bytes < good_bytes) return {flag(Problem::disk_low, check, what)};
  return {fine(check, what)};
}

Finding assess(const ClockInputs& inputs) {
  constexpr const char* check = "clock";
  if (!inputs.known) return flag(Problem::clock_unsynchronised, check, "the kernel does not report it");
  if (!inputs.synchronised) return flag(Problem::clock_unsynchronised, check, "by the kernel's own word");
  return fine(check, fmt::format("synchronised within {:.1f} ms, by the kernel's own word", inputs.max_error_ms));
}

Findings assess(const RealTimeInputs& inputs) {
  constexpr const char* check = "real_time";
  if (!inputs.wanted) return {fine(check, "not asked for ([realtime] priority = 0)")};
  if (inputs.link == 0 && !inputs.unit.empty()) return {fine(check, fmt::format("by its unit, {}", inputs.unit))};
  Findings out;
  const std::string whose = inputs.link == 0 ? "of this user" : fmt::format("of link, process {}", inputs.link);
  if (!inputs.fifo) out.push_back(flag(Problem::no_real_time, check, whose));
  if (!inputs.locked) out.push_back(flag(Problem::no_locked_memory, check, whose));
  if (out.empty())
    out.push_back(fine(check, inputs.link == 0 ? "SCHED_FIFO and locked memory are permitted"
                                               : "SCHED_FIFO and locked memory " + whose));
  return out;
}

Findings assess_place(const SharedMemoryInputs& inputs) {
  constexpr const char* check = "roudi";
  using Roudi = SharedMemoryInputs::Roudi;
  Findings out;
  if (inputs.roudi == Roudi::alive) return out;
  if (!inputs.group_unusable.empty()) out.push_back(flag(Problem::roudi_group, check, inputs.group_unusable));
  if (!inputs.not_writable.empty()) out.push_back(flag(Problem::shm_not_writable, check, inputs.not_writable));
  if (!inputs.no_room.empty()) out.push_back(flag(Problem::shm_small, check, inputs.no_room));
  return out;
}

Findings assess(const SharedMemoryInputs& all) {
  constexpr const char* check = "roudi";
  using Roudi = SharedMemoryInputs::Roudi;
  SharedMemoryInputs inputs = all;
  if (all.by_unit) inputs.group_unusable = inputs.group_shared = "";
  if (inputs.roudi == Roudi::alive && !is_ours(inputs.program))
    return {flag(Problem::roudi_foreign, check, inputs.program)};
  if (inputs.roudi == Roudi::forbidden) return {flag(Problem::roudi_foreign, check, "of another user")};
  Findings out = assess_place(inputs);
  if (!inputs.group_shared.empty()) out.push_back(flag(Problem::roudi_group_shared, check, inputs.group_shared));
  if (inputs.roudi == Roudi::alive) {
    if (!inputs.left_behind.empty()) {
      out.push_back(flag(Problem::roudi_replaced, check, fmt::format("{}", fmt::join(inputs.left_behind, ", "))));
    } else {
      out.push_back(fine(check, "it answers"));
    }
    return out;
  }
  if (inputs.roudi == Roudi::left) out.push_back(flag(Problem::roudi_left, check, "/tmp/roudi"));
  if (inputs.roudi == Roudi::none) out.push_back(flag(Problem::roudi_silent, check, "/tmp/roudi is not there"));
  return out;
}

Finding assess(const InterfaceInputs& inputs) {
  constexpr const char* check = "interface";
  const std::string what = fmt::format("{} of {}", inputs.name, inputs.whose);
  if (!inputs.there) return flag(Problem::interface_missing, check, what);
  if (!inputs.up)
    return flag(Problem::interface_down, check, what + " is down", fmt::format("`ip link set {} up`", inputs.name));
  if (!inputs.has_address) return flag(Problem::interface_down, check, what + " has no address");
  return fine(check, what);
}

Finding assess(const PortInputs& inputs) {
  constexpr const char* check = "state";
  if (!inputs.why.empty()) return flag(Problem::port_unusable, check, fmt::format("{}: {}", inputs.listen, inputs.why));
  if (!inputs.taken) return fine(check, inputs.listen + " is free for link");
  const Problem problem = inputs.is_links ? Problem::state_port_taken : Problem::port_unusable;
  if (inputs.pid == 0) return flag(problem, check, inputs.listen + ", by whom is not to be seen");
  return flag(problem, check, fmt::format("{}, by {}", inputs.listen, inputs.program),
              fmt::format("end it: `kill {}`; then start {}", inputs.pid, inputs.is_links ? "link" : "the flight"));
}

Finding assess_not_running(const std::string& program, const std::string& config) {
  return flag(Problem::not_running, "program", fmt::format("ledgerline-{} by {}", program, config),
              cure_of(Problem::not_running, "PROGRAM", program));
}

Finding assess_names(std::vector<std::string> of_link, std::vector<std::string> of_agent) {
  constexpr const char* check = "config";
  std::sort(of_link.begin(), of_link.end());
  std::sort(of_agent.begin(), of_agent.end());
  if (of_link == of_agent) return fine(check, "link and agent have the same drones");
  return flag(Problem::drones_differ, check,
              fmt::format("link.toml has {}; agent.toml has {}", fmt::join(of_link, ", "), fmt::join(of_agent, ", ")));
}

Finding assess(const RouteInputs& inputs) {
  constexpr const char* check = "route";
  if (inputs.over.empty())
    return of_drone(inputs.drone, flag(Problem::no_route, check, fmt::format("{}: {}", inputs.address, inputs.why)));
  const std::string way = fmt::format("{} over {}", inputs.address, inputs.over);
  const bool is_wanted = inputs.wanted.empty() || inputs.over == inputs.wanted;
  return of_drone(inputs.drone,
                  is_wanted ? fine(check, way) : flag(Problem::wrong_interface, check, way + ", not " + inputs.wanted));
}

Finding assess(const TopicInputs& inputs) {
  constexpr const char* check = "pose";
  const std::string what = fmt::format("{} ({})", inputs.topic, inputs.type);
  if (!inputs.why.empty())
    return of_drone(inputs.drone, flag(Problem::pose_silent, check, fmt::format("{}: {}", what, inputs.why)));
  if (inputs.poses > 0)
    return of_drone(inputs.drone, fine(check, fmt::format("{}: {:.0f} a second", what,
                                                          inputs.poses / std::max(inputs.listened_s, 0.1))));
  return of_drone(
      inputs.drone,
      flag(Problem::pose_silent, check,
           what + (inputs.writers > 0 ? ": somebody publishes there, and nothing that is a pose of this drone"
                                      : ": nobody publishes there")));
}

}  // namespace ledgerline::checks
