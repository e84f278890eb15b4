#include "onboard/link/shell/link_config.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <net/if.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>
#include <utility>

#include "common/config/config.hpp"
#include "common/msg/names.hpp"
#include "onboard/link/core/tello/serial_check.hpp"

namespace ledgerline::link {
namespace {

Result<sockaddr_in> parse_address(const std::string& host, const std::string& port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  std::uint16_t number = 0;
  const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), number);
  if (error != std::errc{} || end != port.data() + port.size() || number == 0 ||
      ::inet_pton(AF_INET, host.c_str(), &address.sin_addr) != 1) {
    return Error{fmt::format(
        "'{}:{}' is not an IPv4 address and port (a name will not do: answers are distinguished by address)", host,
        port)};
  }
  address.sin_port = htons(number);
  return address;
}

TimeNs read_ms(Config& config, const Key& key, TimeNs otherwise, double min_ms, double max_ms) {
  return from_seconds(config.number(key, to_ms(otherwise), min_ms, max_ms) / 1000);
}

TimeNs read_s(Config& config, const Key& key, TimeNs otherwise, double min_s, double max_s) {
  return from_seconds(config.number(key, to_seconds(otherwise), min_s, max_s));
}

float read_float(Config& config, const Key& key, float otherwise, double min, double max) {
  return static_cast<float>(config.number(key, static_cast<double>(otherwise), min, max));
}

void read_limits(Config& config, PlayoutSettings& playout) {
  playout.max_speed_mps = read_float(
      config,
      {"limits.speed_mps",
       "upper bound of the horizontal velocity, whatever a plan says; above what rc 100 means it bounds nothing"},
      playout.max_speed_mps, 0.05, 10);
  playout.max_vertical_mps =
      read_float(config,
                 {"limits.vertical_mps",
                  "upper bound of climbing and sinking: what rc 100 means, so that a higher one bounds nothing"},
                 playout.max_vertical_mps, 0.05, 10);
  playout.max_acceleration_mps2 =
      read_float(config,
                 {"limits.acceleration_mps2",
                  "how fast the velocity asked for may change, and the ramp to zero of a hold: lower stops later. "
                  "Ground must know the same (its flight.max_acceleration_mps2)"},
                 playout.max_acceleration_mps2, 0.1, 50);
  playout.max_yaw_rate_radps = read_float(
      config,
      {"limits.yaw_rate_radps", "upper bound of turning: what rc 100 means, so that nothing is cut short there"},
      playout.max_yaw_rate_radps, 0.01, 10);
  playout.max_yaw_acceleration_radps2 =
      read_float(config, {"limits.yaw_acceleration_radps2", "how fast the rate of turning may change"},
                 playout.max_yaw_acceleration_radps2, 0.1, 100);
}

void read_playout(Config& config, PlayoutSettings& playout) {
  playout.max_age_ns = read_ms(config,
                               {"playout.max_age_ms",
                                "a plan made from an older state is dropped: longer flies by what is no longer true, "
                                "shorter than the two-way latency drops every plan"},
                               playout.max_age_ns, 10, 60'000);
  playout.max_ahead_ns = read_ms(
      config, {"playout.max_ahead_ms", "a setpoint meant for later than this is a bad value, such as of a wrong clock"},
      playout.max_ahead_ns, 10, 60'000);
  playout.max_margin_ns =
      read_ms(config,
              {"playout.max_margin_ms",
               "upper bound of the adaptive playout margin, by which setpoints wait so that late ones still come in "
               "order; 0 disables it, as in a flight around a path, where ground chooses the moment"},
              playout.max_margin_ns, 0, 10'000);
}

void read_rc(Config& config, RcSettings& rc) {
  rc.full_scale_mps = read_float(
      config,
      {"rc.full_scale_mps", "the velocity that rc 100 means; not documented by the maker, clients take rc as cm/s"},
      rc.full_scale_mps, 0.1, 20);
  rc.full_scale_radps =
      read_float(config, {"rc.full_scale_radps", "the rate of turning that rc 100 means: 100 degrees/s"},
                 rc.full_scale_radps, 0.1, 20);
  const auto signs =
      config.numbers({"rc.signs", "sign of each rc channel against left, forward, up, counter-clockwise"}, 4,
                     {rc.signs[0], rc.signs[1], rc.signs[2], rc.signs[3]});
  for (std::size_t i = 0; i < 4 && i < signs.size(); ++i) rc.signs[i] = signs[i] < 0 ? -1.0F : 1.0F;
}

void read_failsafe(Config& config, FailsafeSettings& failsafe) {
  failsafe.hold_grace_ns = read_ms(
      config,
      {"failsafe.hold_grace_ms",
       "from the end of the last plan until the mode says hold; the ramp to zero begins at once. Shorter reports "
       "each plan that is a little late"},
      failsafe.hold_grace_ns, 0, 5'000);
  failsafe.land_after_ns = read_s(config,
                                  {"failsafe.land_after_s",
                                   "of hold or brake without a break, then land: longer than a ledger takes to choose "
                                   "a new leader, and than clear_after_ms"},
                                  failsafe.land_after_ns, 0.1, 600);
  // At half of it, what comes as seldom as it may must still be in time: agent's heartbeats each 100 ms, state texts
  // too.
  failsafe.agent_silent_ns = read_ms(config,
                                     {"failsafe.agent_silent_ms",
                                      "without a heartbeat of agent, it counts as gone: ten heartbeats of 50 ms. From "
                                      "250, since heartbeats may be 100 ms apart"},
                                     failsafe.agent_silent_ns, 250, 60'000);
  failsafe.state_stale_ns = read_ms(
      config, {"failsafe.state_stale_ms", "without a state text of the drone, brake: ten texts at a Tello's 10 Hz"},
      failsafe.state_stale_ns, 250, 60'000);
  failsafe.pose_lost_ns = read_ms(
      config,
      {"failsafe.pose_lost_ms",
       "without a new pose, brake: at 1 m/s the drone goes 0.3 m unmeasured meanwhile; ground must know the same "
       "(its flight.pose_lost_ms)"},
      failsafe.pose_lost_ns, 20, 60'000);
  failsafe.velocity_lost_ns = read_ms(
      config,
      {"failsafe.velocity_lost_ms",
       "of a drone that is flown by onboard odometry: without a usable velocity, brake; texts come each 100 ms"},
      failsafe.velocity_lost_ns, 250, 60'000);
  failsafe.dark_land_after_ns = read_ms(
      config,
      {"failsafe.dark_land_after_ms",
       "of a drone whose flow sees nothing and that nothing else places or holds: hovering blindly so long, then land. "
       "Shorter lands who sees again, longer glides on in the dark"},
      failsafe.dark_land_after_ns, 0, 5'000);
  failsafe.fence_sigmas =
      config.number({"failsafe.fence_sigmas", "the fence is drawn in by so many standard deviations of the position"},
                    failsafe.fence_sigmas, 0, 10);
  failsafe.min_room_m = config.number(
      {"failsafe.min_room_m", "so much of the fence must then be left along x and y, or no path is flown: brake"},
      failsafe.min_room_m, 0.1, 100);
  failsafe.clear_after_ns =
      read_ms(config,
              {"failsafe.clear_after_ms",
               "a brake ends when its cause has been away this long; at least half of each of the "
               "limits above, or a lonely sign of life would end it"},
              failsafe.clear_after_ns, 0, 60'000);
  failsafe.on_untrusted_ledger =
      from_name<OnUntrustedLedger>(
          config.choice(
              {"failsafe.on_untrusted_ledger",
               "when agent does not trust the ledger: brake and hover, or land, and do not take off. What cannot be "
               "trusted is left out "
               "anyway, and a peer or relay that feeds agent blocks would bring drones down"},
              {name(OnUntrustedLedger::ignore), name(OnUntrustedLedger::hold), name(OnUntrustedLedger::land)},
              name(failsafe.on_untrusted_ledger)))
          .value_or(failsafe.on_untrusted_ledger);
  failsafe.battery_low =
      read_float(config, {"failsafe.battery_low", "share of a full battery: below it a warning, and no take-off"},
                 failsafe.battery_low, 0.01, 0.95);
  failsafe.battery_critical =
      read_float(config, {"failsafe.battery_critical", "share of a full battery: below it land; below battery_low"},
                 failsafe.battery_critical, 0, 1);
}

// True: both corners are in the file.
bool read_fence(Config& config, LinkSettings& link) {
  FenceSettings& fence = link.fence;
  const auto low = config.numbers({"fence.min_m", "corner of the box that a drone stays in, x, y, z in `map`"}, 3,
                                  {fence.min_m.begin(), fence.min_m.end()});
  const auto high = config.numbers(
      {"fence.max_m",
       "its other corner; the default is so wide that it bounds the height alone until you set your room's"},
      3, {fence.max_m.begin(), fence.max_m.end()});
  for (std::size_t i = 0; i < 3 && i < low.size() && i < high.size(); ++i) {
    fence.min_m[i] = low[i];
    fence.max_m[i] = high[i];
  }
  link.failsafe.fence_land_after_ns = read_ms(
      config,
      {"fence.land_after_ms",
       "beyond the fence and still going outward for this long: land. Shorter lands who is already turning back"},
      link.failsafe.fence_land_after_ns, 0, 60'000);
  fence.far_beyond_m =
      config.number({"fence.far_beyond_m", "beyond the fence by this counts as going outward at any speed"},
                    fence.far_beyond_m, 0, 1000);
  const std::string said = config.table_text("fence");
  return said.find("min_m") != std::string::npos && said.find("max_m") != std::string::npos;
}

// Whether drones are reached over UDP.
bool read_transport(Config& config, ShellSettings& settings) {
  const bool udp =
      config.choice({"tello.transport",
                     "how drones are reached: udp, or shim: simulated ones through shared memory, without a network "
                     "(docs/faults.md). The other keys of [tello] and [state] listen are udp's"},
                    {"udp", "shim"}, "udp") == "udp";
  const std::string memory = config.text({"shim.memory", "the file in /dev/shm that `ledgerline hil shim` made"}, "");
  settings.lockstep = config.boolean(
      {"shim.lockstep", "the shim moves link's clock, and says plans, poses and signs of life in agent's place"},
      false);
  if (udp && settings.lockstep) config.wrong("shim.lockstep", "goes with tello.transport = \"shim\" alone");
  if (!udp && memory.empty()) config.wrong("shim.memory", "is needed with tello.transport = \"shim\"");
  if (!udp) settings.shim = memory;
  return udp;
}

struct DroneTable {
  DroneSettings drone;
  std::string address, interface;
};

std::vector<DroneTable> read_drones(Config& config, const PoseSettings& pose, bool udp) {
  std::vector<DroneTable> tables;
  for (std::size_t i = 0; i < config.table_count({"drone", "1 to 16 of them, one for each drone"}); ++i) {
    const std::string key = fmt::format("drone.{}.", i);
    DroneTable table;
    table.drone.name = config.text({key + "name", "as it is enrolled on the ledger"});
    table.drone.number = static_cast<DroneNumber>(
        config.integer({key + "number", "in shared memory; agent's must be the same", "its place in the file"},
                       static_cast<std::int64_t>(i) + 1, 1, max_drones));
    read_drone_pose(config, key, pose, table.drone);
    const Key address{key + "address",
                      "IPv4; drones are distinguished by it, and by their interfaces. Through the shim, by `number`"};
    table.address = udp ? config.text(address) : config.text(address, "");
    table.interface =
        config.text({key + "interface",
                     "network interface that the drone is behind, such as wlan1: with one for each, several drones may "
                     "have 192.168.10.1"},
                    "");
    table.drone.serial = config.text(
        {key + "serial", "what it must answer to `sn?` before a take-off (`ledgerline tello find` shows it)"}, "");
    tables.push_back(std::move(table));
  }
  return tables;
}

Status check_drones(const std::string& path, const std::vector<DroneTable>& tables, bool udp) {
  if (tables.empty() || tables.size() > max_drones)
    return Error{fmt::format("{}: 1 to {} [[drone]] are needed", path, max_drones)};
  std::set<DroneNumber> numbers;
  std::set<std::pair<std::string, std::string>> ways;
  for (const DroneTable& table : tables) {
    if (!numbers.insert(table.drone.number).second)
      return Error{fmt::format("{}: two drones have number {}", path, table.drone.number)};
    if (udp && !ways.emplace(table.address, table.interface).second)
      return Error{fmt::format("{}: two drones have address {}{}", path, table.address,
                               table.interface.empty()
                                   ? "; behind interfaces of their own they may: give each its interface"
                                   : " behind interface " + table.interface)};
    if (table.interface.size() >= IFNAMSIZ)
      return Error{fmt::format("{}: drone {}: '{}' is no interface's name, which has at most {} characters", path,
                               table.drone.name, table.interface, IFNAMSIZ - 1)};
    if (!table.drone.serial.empty() && !is_serial(table.drone.serial))
      return Error{fmt::format("{}: drone {}: '{}' is no serial: 4 to 24 a-z, A-Z and 0-9", path, table.drone.name,
                               table.drone.serial)};
  }
  // Else a datagram of the one would be the other's as well.
  for (const DroneTable& table : tables) {
    if (!udp || !table.interface.empty()) continue;
    for (const DroneTable& other : tables) {
      if (&other != &table && other.address == table.address)
        return Error{fmt::format("{}: two drones have address {}: give each its interface", path, table.address)};
    }
  }
  return done;
}

void read_separation(Config& config, SeparationSettings& separation) {
  separation.min_m = config.number(
      {"separation.min_m",
       "drones of this host never come nearer to each other, centre to centre; 0 switches it off. Larger needs more "
       "room to pass"},
      separation.min_m, 0, 10);
}

// What is no simulation: simulated drones and a proxy's are on loopback, or behind the shim.
const DroneTable* real_drone(const std::vector<DroneTable>& tables, bool udp) {
  const auto found = std::find_if(tables.begin(), tables.end(), [&](const DroneTable& table) {
    return udp && (!table.interface.empty() ? table.interface != "lo" : !table.address.starts_with("127."));
  });
  return found == tables.end() ? nullptr : &*found;
}

// The default is so wide that it is none. A fence without room inside would hold every drone at once.
Status check_fence(const std::string& path, const FenceSettings& fence, bool has_both, const DroneTable* real) {
  if (real != nullptr && !has_both) {
    return Error{fmt::format(
        "{}: [fence] min_m and max_m must be there, x, y, z in m in `map`: drone {} at {} is a real one, and real "
        "drones "
        "are not flown without a fence (the default is 40 m by 40 m; simulated drones, at 127.x.x.x, keep it)",
        path, real->drone.name, real->address)};
  }
  for (std::size_t i = 0; i < 3; ++i) {
    if (fence.min_m[i] >= fence.max_m[i]) {
      return Error{fmt::format("{}: fence.min_m must be below fence.max_m: {} and {} ({})", path, fence.min_m[i],
                               fence.max_m[i], "xyz"[i])};
    }
  }
  return done;
}

// The table's rows count on this order (docs/failsafe.md, FS-29).
Status check_failsafe(const std::string& path, const FailsafeSettings& failsafe) {
  for (const auto& [key, limit_ns] :
       {std::pair("agent_silent_ms", failsafe.agent_silent_ns), std::pair("state_stale_ms", failsafe.state_stale_ns),
        std::pair("pose_lost_ms", failsafe.pose_lost_ns), std::pair("velocity_lost_ms", failsafe.velocity_lost_ns)}) {
    if (failsafe.clear_after_ns >= limit_ns / 2) continue;
    return Error{fmt::format(
        "{}: failsafe.clear_after_ms must be at least half of failsafe.{}: {:.0f} and {:.0f} (or a lonely sign of life "
        "ends a brake or a silence)",
        path, key, to_ms(failsafe.clear_after_ns), to_ms(limit_ns))};
  }
  if (failsafe.land_after_ns <= failsafe.clear_after_ns) {
    return Error{
        fmt::format("{}: failsafe.land_after_s must be longer than failsafe.clear_after_ms: {:.3f} s and {:.0f} ms (or "
                    "no brake ends "
                    "but in a landing)",
                    path, to_seconds(failsafe.land_after_ns), to_ms(failsafe.clear_after_ns))};
  }
  if (failsafe.battery_critical >= failsafe.battery_low) {
    return Error{fmt::format("{}: failsafe.battery_critical must be below failsafe.battery_low: {} and {}", path,
                             failsafe.battery_critical, failsafe.battery_low)};
  }
  return done;
}

void read_output(Config& config, ShellSettings& settings) {
  settings.trace = config.text({"output.trace", "file for `ledgerline timing` and the report (binary)"}, "");
  settings.summary = config.text({"output.summary", "file with all counts, JSON, written at the end"}, "");
  settings.starts =
      config.text({"output.starts",
                   "file that remembers link's last starts, so that one that dies again and again lands its drones"},
                  "");
  settings.local_stops = config.text(
      {"output.local_stops",
       "file that remembers which drones SIGTERM has landed: they stay down, whatever starts again, until the "
       "owner's organisation clears their stop on the ledger, or link gets SIGUSR1"},
      "");
  settings.status_period_ms = config.integer(
      {"output.status_period_ms", "between two status lines on standard output (JSON); 0: none"}, 0, 0, 60'000);
}

}  // namespace

void read_bounds(Config& config, LinkSettings& link) {
  read_limits(config, link.playout);
  read_rc(config, link.rc);
  (void)read_fence(config, link);
}

Result<ShellSettings> load_settings(const std::string& path) {
  auto config = Config::load(path);
  if (!config) return config.error();
  return read_settings(*config, path);
}

Result<ShellSettings> read_settings(Config& config, const std::string& path) {
  ShellSettings settings;
  const PoseSettings pose = read_pose(config);
  settings.link.pads = pose.pads;
  const bool udp = read_transport(config, settings);
  const auto tables = read_drones(config, pose, udp);
  const auto command_port = config.integer(
      {"tello.command_port", "where drones take commands; a Tello's is fixed, a proxy's may differ"}, 8889, 1, 65535);
  const std::string port = std::to_string(command_port);
  settings.state_port = static_cast<std::uint16_t>(config.integer(
      {"tello.state_port", "where drones send state text from: what comes from another port is not trusted. 0: any",
       "tello.command_port"},
      command_port, 0, 65535));
  const std::string listen = config.text(
      {"state.listen", "IPv4 and port where state texts arrive; drones always send to port 8890"}, "0.0.0.0:8890");
  settings.link.rate_hz = config.number({"state.rate_hz",
                                         "state samples a second of each drone: each is a transaction, or shares one; "
                                         "ground answers each with a command"},
                                        settings.link.rate_hz, 1, 200);
  read_output(config, settings);
  settings.loop_hz = config.number(
      {"realtime.loop_hz", "turns of the loop: a setpoint waits for at most one. Half of it doubles that wait"},
      settings.loop_hz, 100, 4000);
  settings.priority = static_cast<int>(config.integer(
      {"realtime.priority", "SCHED_FIFO, above agent's and below the kernel's own 99; 0: ordinary scheduling"},
      settings.priority, 0, 98));
  settings.cpu = static_cast<int>(
      config.integer({"realtime.cpu", "core that the loop is pinned to; -1: any"}, settings.cpu, -1, 1023));
  read_limits(config, settings.link.playout);
  read_playout(config, settings.link.playout);
  read_rc(config, settings.link.rc);
  read_failsafe(config, settings.link.failsafe);
  const bool fenced = read_fence(config, settings.link);
  read_separation(config, settings.link.separation);
  if (auto status = config.finish(); !status) return status.error();
  if (auto status = check_drones(path, tables, udp); !status) return status.error();
  if (auto status = check_fence(path, settings.link.fence, fenced, real_drone(tables, udp)); !status)
    return status.error();
  if (auto status = check_failsafe(path, settings.link.failsafe); !status) return status.error();

  const std::size_t colon = listen.rfind(':');
  auto state_listen = colon == std::string::npos ? parse_address(listen, "")
                                                 : parse_address(listen.substr(0, colon), listen.substr(colon + 1));
  if (!state_listen) return Error{fmt::format("{}: state.listen: {}", path, state_listen.error().message)};
  settings.state_listen = *state_listen;
  for (const DroneTable& table : tables) {
    settings.link.drones.push_back(table.drone);
    if (!udp) continue;
    auto address = parse_address(table.address, port);
    if (!address) return Error{fmt::format("{}: drone {}: {}", path, table.drone.name, address.error().message)};
    settings.addresses.push_back(*address);
    settings.interfaces.push_back(table.interface);
  }
  if (auto status = check_poses(path, settings.link); !status) return status.error();
  return settings;
}

}  // namespace ledgerline::link
