#include "tools/doctor/core/host.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace ledgerline::doctor {
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

Finding assess(const StatePortFacts& facts) {
  constexpr const char* check = "state";
  if (!facts.taken) return fine(check, facts.listen + " is free for link");
  if (facts.pid == 0) return found(Problem::state_port_taken, check, facts.listen + ", by whom is not to be seen");
  return found(Problem::state_port_taken, check, fmt::format("{}, by {}", facts.listen, facts.program),
               fmt::format("end it: `kill {}`; then start link", facts.pid));
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
  const std::string what = fmt::format("{} at {}", facts.drone, facts.address);
  if (facts.over.empty()) return found(Problem::no_route, check, fmt::format("{}: {}", what, facts.why));
  if (!facts.wanted.empty() && facts.over != facts.wanted)
    return found(Problem::wrong_interface, check, fmt::format("{}: over {}, not {}", what, facts.over, facts.wanted));
  return fine(check, fmt::format("{} over {}", what, facts.over));
}

Findings assess(const DroneFacts& facts) {
  constexpr const char* check = "drone";
  const std::string what = fmt::format("{} at {}", facts.name, facts.address);
  if (!facts.there) return {found(Problem::drone_silent, check, what)};
  Findings out;
  if (facts.states == false) {
    const std::string port = facts.listen.substr(facts.listen.rfind(':') + 1);
    out.push_back(
        found(Problem::state_silent, check, fmt::format("{}: none at {}", what, facts.listen),
              fmt::format("let the port through at this host: `iptables -I INPUT -p udp --dport {0} -j ACCEPT`, "
                          "`ufw allow {0}/udp` or `firewall-cmd --add-port={0}/udp`, whichever firewall it has",
                          port)));
  }
  if (!facts.battery) {
    out.push_back(fine(check, what + " answers, and does not report its battery"));
    return out;
  }
  const std::string share = fmt::format("{}: {:.0f} %", what, 100 * *facts.battery);
  out.push_back(*facts.battery <= facts.battery_low ? found(Problem::battery_low, check, share) : fine(check, share));
  return out;
}

Finding assess(const PoseFacts& facts) {
  constexpr const char* check = "poses";
  const std::string what = fmt::format("{} at {} ({})", facts.drone, facts.topic, facts.type);
  if (!facts.why.empty()) return found(Problem::pose_silent, check, fmt::format("{}: {}", what, facts.why));
  if (facts.poses > 0)
    return fine(check, fmt::format("{}: {:.0f} a second", what, facts.poses / std::max(facts.listened_s, 0.1)));
  return found(Problem::pose_silent, check,
               facts.writers > 0 ? what + ": somebody publishes there, and nothing that is a pose of this drone"
                                 : what + ": nobody publishes there");
}

}  // namespace ledgerline::doctor
