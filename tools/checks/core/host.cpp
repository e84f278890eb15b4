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

Findings assess(const DirectoryFacts& facts) {
  constexpr const char* check = "disk";
  if (facts.read_only)
    return {
        found(Problem::disk_read_only, check, facts.path,
              fmt::format("`mount -o remount,rw $(findmnt -n -o TARGET -T {})`; `dmesg` says whether the kernel did "
                          "it after errors: then replace the card or disk",
                          facts.path))};
  if (!facts.writable)
    return {found(Problem::state_folder, check, facts.path,
                  fmt::format("`install -d -o {} {}`, or run doctor as the user of the programs", user_of(facts.path),
                              facts.path))};
  if (!facts.free_bytes) return {fine(check, facts.path)};
  const std::string what = fmt::format("{}: {} MB free", facts.path, *facts.free_bytes >> 20);
  if (*facts.free_bytes < least_bytes) return {found(Problem::disk_full, check, what)};
  if (*facts.free_bytes < good_bytes) return {found(Problem::disk_low, check, what)};
  return {fine(check, what)};
}

Finding assess(const ClockFacts& facts) {
  constexpr const char* check = "clock";
  if (!facts.known) return found(Problem::clock_unsynchronised, check, "the kernel does not report it");
  if (!facts.synchronised) return found(Problem::clock_unsynchronised, check, "by the kernel's own word");
  return fine(check, fmt::format("synchronised within {:.1f} ms, by the kernel's own word", facts.max_error_ms));
}

Findings assess(const RealTimeFacts& facts) {
  constexpr const char* check = "real_time";
  if (!facts.wanted) return {fine(check, "not asked for ([realtime] priority = 0)")};
  if (!facts.unit.empty()) return {fine(check, fmt::format("by its unit, {}", facts.unit))};
  Findings out;
  if (!facts.fifo) out.push_back(found(Problem::no_real_time, check, "of this user"));
  if (!facts.locked) out.push_back(found(Problem::no_locked_memory, check, "of this user"));
  if (out.empty()) out.push_back(fine(check, "SCHED_FIFO and locked memory are permitted"));
  return out;
}

Findings assess(const SharedMemoryFacts& facts) {
  constexpr const char* check = "roudi";
  using Roudi = SharedMemoryFacts::Roudi;
  if (facts.roudi == Roudi::alive && !is_ours(facts.program))
    return {found(Problem::roudi_foreign, check, facts.program)};
  if (facts.roudi == Roudi::forbidden) return {found(Problem::roudi_foreign, check, "of another user")};
  if (facts.roudi == Roudi::alive) return {fine(check, "it answers")};
  Findings out;
  if (facts.roudi == Roudi::left) out.push_back(found(Problem::roudi_left, check, "/tmp/roudi"));
  if (facts.roudi == Roudi::none) out.push_back(found(Problem::roudi_silent, check, "/tmp/roudi is not there"));
  if (!facts.no_room.empty()) out.push_back(found(Problem::shm_small, check, facts.no_room));
  return out;
}

Finding assess(const InterfaceFacts& facts) {
  constexpr const char* check = "interface";
  const std::string what = fmt::format("{} of {}", facts.name, facts.whose);
  if (!facts.there) return found(Problem::interface_missing, check, what);
  if (!facts.up)
    return found(Problem::interface_down, check, what + " is down", fmt::format("`ip link set {} up`", facts.name));
  if (!facts.has_address) return found(Problem::interface_down, check, what + " has no address");
  return fine(check, what);
}

Finding assess(const PortFacts& facts) {
  constexpr const char* check = "state";
  if (!facts.why.empty()) return found(Problem::port_unusable, check, fmt::format("{}: {}", facts.listen, facts.why));
  if (!facts.taken) return fine(check, facts.listen + " is free for link");
  const Problem problem = facts.is_links ? Problem::state_port_taken : Problem::port_unusable;
  if (facts.pid == 0) return found(problem, check, facts.listen + ", by whom is not to be seen");
  return found(problem, check, fmt::format("{}, by {}", facts.listen, facts.program),
               fmt::format("end it: `kill {}`; then start {}", facts.pid, facts.is_links ? "link" : "the flight"));
}

Finding assess_names(std::vector<std::string> of_link, std::vector<std::string> of_agent) {
  constexpr const char* check = "config";
  std::sort(of_link.begin(), of_link.end());
  std::sort(of_agent.begin(), of_agent.end());
  if (of_link == of_agent) return fine(check, "link and agent have the same drones");
  return found(Problem::drones_differ, check,
               fmt::format("link.toml has {}; agent.toml has {}", fmt::join(of_link, ", "), fmt::join(of_agent, ", ")));
}

Finding assess(const RouteFacts& facts) {
  constexpr const char* check = "route";
  if (facts.over.empty())
    return of_drone(facts.drone, found(Problem::no_route, check, fmt::format("{}: {}", facts.address, facts.why)));
  const std::string way = fmt::format("{} over {}", facts.address, facts.over);
  const bool is_wanted = facts.wanted.empty() || facts.over == facts.wanted;
  return of_drone(facts.drone,
                  is_wanted ? fine(check, way) : found(Problem::wrong_interface, check, way + ", not " + facts.wanted));
}

Finding assess(const TopicFacts& facts) {
  constexpr const char* check = "pose";
  const std::string what = fmt::format("{} ({})", facts.topic, facts.type);
  if (!facts.why.empty())
    return of_drone(facts.drone, found(Problem::pose_silent, check, fmt::format("{}: {}", what, facts.why)));
  if (facts.poses > 0)
    return of_drone(facts.drone, fine(check, fmt::format("{}: {:.0f} a second", what,
                                                         facts.poses / std::max(facts.listened_s, 0.1))));
  return of_drone(
      facts.drone,
      found(Problem::pose_silent, check,
            what + (facts.writers > 0 ? ": somebody publishes there, and nothing that is a pose of this drone"
                                      : ": nobody publishes there")));
}

}  // namespace ledgerline::checks
