#include "onboard/link/shell/link_config.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <net/if.h>

#include <algorithm>
#include <charconv>
#include <set>
#include <utility>

#include "common/msg/contract.hpp"
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

// Each reads a key into the value that it sets, which is its default as well.
template <typename Number>
void read_number(Config& config, const char* key, Number& value, double min, double max, std::string_view about) {
  value = static_cast<Number>(config.number({key, about}, static_cast<double>(value), min, max));
}

void read_ms(Config& config, const char* key, TimeNs& value, double min, double max, std::string_view about) {
  value = from_seconds(config.number({key, about}, to_ms(value), min, max) / 1000);
}

void read_s(Config& config, const char* key, TimeNs& value, double min, double max, std::string_view about) {
  value = from_seconds(config.number({key, about}, to_seconds(value), min, max));
}

template <typename Enum>
Enum read_choice(Config& config, const Key& key, Enum otherwise) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < enum_count<Enum>; ++i) names.emplace_back(name(static_cast<Enum>(i)));
  return from_name<Enum>(config.choice(key, names, std::string(name(otherwise)))).value_or(otherwise);
}

void read_limits(Config& config, PlayoutSettings& playout) {
  read_number(config, "limits.speed_mps", playout.max_speed_mps, 0.05, 10,
              "horizontal, whatever a plan says; above rc.full_scale_mps it bounds nothing");
  read_number(config, "limits.vertical_mps", playout.max_vertical_mps, 0.05, 10,
              "climbing and sinking; above rc.full_scale_mps it bounds nothing");
  read_number(config, "limits.acceleration_mps2", playout.max_acceleration_mps2, 0.1, 50,
              "of the commanded velocity, and of a hold's ramp to zero: lower stops later. The same in ground's "
              "flight.max_acceleration_mps2");
  read_number(config, "limits.yaw_rate_radps", playout.max_yaw_rate_radps, 0.01, 10,
              "turning; above rc.full_scale_radps it bounds nothing");
  read_number(config, "limits.yaw_acceleration_radps2", playout.max_yaw_acceleration_radps2, 0.1, 100,
              "change of the turning rate");
}

void read_playout(Config& config, PlayoutSettings& playout) {
  read_ms(config, "playout.max_age_ms", playout.max_age_ns, 10, 60'000,
          "a plan from an older state is dropped; below the two-way latency every plan is");
  read_ms(config, "playout.max_ahead_ms", playout.max_ahead_ns, 10, 60'000,
          "a setpoint for later than this counts as bad, as of a wrong clock");
  read_ms(config, "playout.max_margin_ms", playout.max_margin_ns, 0, 10'000,
          "bound of the adaptive playout margin, for which setpoints wait so that late ones come in order; 0: none, as "
          "in flights around a path");
}

void read_rc(Config& config, RcSettings& rc) {
  read_number(config, "rc.full_scale_mps", rc.full_scale_mps, 0.1, 20,
              "the velocity of rc 100; undocumented, clients take rc as cm/s");
  read_number(config, "rc.full_scale_radps", rc.full_scale_radps, 0.1, 20, "the turning rate of rc 100: 100 degrees/s");
  const auto signs = config.numbers({"rc.signs", "of the rc channels against left, forward, up, counter-clockwise"}, 4,
                                    {rc.signs[0], rc.signs[1], rc.signs[2], rc.signs[3]});
  for (std::size_t i = 0; i < 4 && i < signs.size(); ++i) rc.signs[i] = signs[i] < 0 ? -1.0F : 1.0F;
}

void read_failsafe(Config& config, FailsafeSettings& failsafe) {
  read_ms(config, "failsafe.hold_grace_ms", failsafe.hold_grace_ns, 0, 5'000,
          "from the end of the last plan to mode hold; the ramp to zero begins at once");
  read_s(config, "failsafe.land_after_s", failsafe.land_after_ns, 0.1, 600,
         "of hold or brake, then land; longer than a change of the ledger's leader, and than clear_after_ms");
  // At half of it, what comes each 100 ms (heartbeats, state texts) must still be in time.
  read_ms(config, "failsafe.agent_silent_ms", failsafe.agent_silent_ns, 250, 60'000,
          "without agent's heartbeats (each 50 ms), it counts as gone");
  read_ms(config, "failsafe.state_stale_ms", failsafe.state_stale_ns, 250, 60'000,
          "without a state text (10 a second), brake");
  read_ms(config, "failsafe.pose_lost_ms", failsafe.pose_lost_ns, 20, 60'000,
          "without a new pose, brake: 0.3 m unmeasured at 1 m/s. The same in ground's flight.pose_lost_ms");
  read_ms(config, "failsafe.velocity_lost_ms", failsafe.velocity_lost_ns, 250, 60'000,
          "with onboard odometry: without a usable velocity, brake");
  read_ms(config, "failsafe.dark_land_after_ms", failsafe.dark_land_after_ns, 0, 5'000,
          "a drone whose flow sees nothing, and that nothing else places or holds, hovers blindly so long, then lands");
  read_number(config, "failsafe.fence_sigmas", failsafe.fence_sigmas, 0, 10,
              "the fence is drawn in by so many standard deviations of the position");
  read_number(config, "failsafe.min_room_m", failsafe.min_room_m, 0.1, 100,
              "of that fence left along x and y, else no path is flown: brake");
  read_ms(config, "failsafe.clear_after_ms", failsafe.clear_after_ns, 0, 60'000,
          "a brake ends when its cause has been away so long; at least half of each limit above, or a single message "
          "would end it");
  failsafe.on_untrusted_ledger =
      read_choice(config,
                  {"failsafe.on_untrusted_ledger",
                   "when agent does not trust the ledger: brake and hover, or land; no take-off. Untrusted records are "
                   "left out anyway, and with hold or land a peer or relay can bring drones down"},
                  failsafe.on_untrusted_ledger);
  read_number(config, "failsafe.battery_low", failsafe.battery_low, 0.01, 0.95,
              "share of a full battery: below it a warning and no take-off");
  read_number(config, "failsafe.battery_critical", failsafe.battery_critical, 0, 1,
              "below it land; less than battery_low");
}

// True: both corners are in the file.
bool read_fence(Config& config, LinkSettings& link) {
  FenceSettings& fence = link.fence;
  const auto low = config.numbers({"fence.min_m", "corner of the drones' box, x, y, z in `map`"}, 3,
                                  {fence.min_m.begin(), fence.min_m.end()});
  const auto high =
      config.numbers({"fence.max_m", "its other corner: set your room's, since the default bounds the height alone"}, 3,
                     {fence.max_m.begin(), fence.max_m.end()});
  for (std::size_t i = 0; i < 3 && i < low.size() && i < high.size(); ++i) {
    fence.min_m[i] = low[i];
    fence.max_m[i] = high[i];
  }
  read_ms(config, "fence.land_after_ms", link.failsafe.fence_land_after_ns, 0, 60'000,
          "beyond the fence and going outward for so long: land");
  read_number(config, "fence.far_beyond_m", fence.far_beyond_m, 0, 1000,
              "so far beyond the fence counts as going outward at any speed");
  const std::string said = config.table_text("fence");
  return said.find("min_m") != std::string::npos && said.find("max_m") != std::string::npos;
}

// Whether drones are reached over UDP.
bool read_transport(Config& config, ShellSettings& settings) {
  const bool udp = config.choice({"tello.transport",
                                  "UDP, or shared memory to simulated drones (docs/faults.md), without the other keys "
                                  "of [tello] and [state] listen"},
                                 {"udp", "shim"}, "udp") == "udp";
  const std::string memory = config.text({"shim.memory", "file in /dev/shm that `ledgerline hil shim` made"}, "");
  settings.lockstep = config.boolean(
      {"shim.lockstep", "the shim moves link's clock, and gives plans, poses and heartbeats in agent's place"}, false);
  if (udp && settings.lockstep) config.wrong("shim.lockstep", "goes with tello.transport = \"shim\" alone");
  if (!udp && memory.empty()) config.wrong("shim.memory", "is needed with tello.transport = \"shim\"");
  if (!udp) settings.shim = memory;
  return udp;
}

void read_odometry(Config& config, PoseSettings& pose) {
  OdometrySettings& odometry = pose.odometry;
  const auto signs = config.numbers(
      Key{"pose.velocity_signs",
          "of vgx, vgy, vgz against forward, left, up, as `calibrate` measures them; required with onboard odometry",
          "none"},
      3, {});
  pose.has_signs = signs.size() == 3;
  for (std::size_t i = 0; i < 3 && pose.has_signs; ++i) odometry.velocity_signs[i] = signs[i] < 0 ? -1.0F : 1.0F;
  odometry.velocity_in_body =
      config.choice({"pose.velocity_frame", "of vgx, vgy, vgz: fixed at power on, or turning with the drone"},
                    {"power_on", "body"}, "power_on") == "body";
  read_number(config, "pose.flow_mps", odometry.flow_mps, 0.001, 1, "standard deviation of the velocities' slow error");
  read_number(config, "pose.flow_s", odometry.flow_s, 0.1, 600, "its correlation time");
  read_number(config, "pose.flow_scale", odometry.flow_scale, 0, 0.5,
              "standard deviation of the velocities' scale; wide until measured");
  odometry.velocity_scale = config.number({"pose.velocity_scale", "factor from vgx and vgy to m/s"}, 1, 0.5, 2);
  odometry.velocity_truncated =
      config.boolean({"pose.velocity_truncated", "vgx and vgy are truncated to whole dm/s, not rounded"}, false);
  read_number(config, "pose.velocity_lag_s", odometry.velocity_lag_s, 0, 1, "delay of vgx and vgy");
  read_number(config, "pose.velocity_lag_sd_s", odometry.velocity_lag_sigma_s, 0, 1, "its standard deviation");
  read_number(config, "pose.max_unfixed_s", odometry.max_unfixed_s, 1, 3600,
              "with pads: brake after so long without one");
  read_number(config, "pose.max_unfixed_m", odometry.max_unfixed_m, 1, 10'000,
              "with pads: brake after so far without one");
}

void read_pads(Config& config, std::vector<PadSettings>& pads) {
  for (std::size_t i = 0; i < config.table_count({"pad", "mission pads, for source \"pads\""}); ++i) {
    const std::string key = fmt::format("pad.{}.", i);
    PadSettings pad;
    pad.id = static_cast<int>(config.number({key + "id", "printed on the pad"}, 1, 8));
    const auto place = config.numbers({key + "position_m", "of its middle, x, y, z in `map`"}, 3, {});
    if (place.size() != 3 && !config.is_describing())
      config.wrong(key + "position_m", "must be there: where the pad lies");
    std::copy_n(place.begin(), std::min<std::size_t>(3, place.size()), pad.position_m.begin());
    pad.yaw_rad = config.number({key + "yaw_rad", "where its arrow points, counter-clockwise from x"}, 0, -7, 7);
    pads.push_back(pad);
  }
}

void read_start(Config& config, const std::string& key, OdometrySettings& odometry) {
  const auto start = config.numbers(
      {key + "start_m", "where it stands when link first sees it, x, y, z in `map`; for onboard odometry"}, 3,
      {0, 0, 0});
  std::copy_n(start.begin(), std::min<std::size_t>(3, start.size()), odometry.start_m.begin());
  odometry.start_yaw_rad =
      config.number({key + "start_yaw_rad", "where its nose points then, counter-clockwise from x"}, 0, -7, 7);
}

// Two that would be at one place have no common frame: they would not know of each other.
Status check_starts(const std::string& path, const LinkSettings& link) {
  for (std::size_t i = 0; i < link.drones.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      const DroneSettings &one = link.drones[k], &other = link.drones[i];
      if (uses_mocap(one.source) || uses_mocap(other.source)) continue;
      if (!one.in_common_frame || !other.in_common_frame) continue;
      const auto &a = one.odometry.start_m, &b = other.odometry.start_m;
      if (std::hypot(a[0] - b[0], a[1] - b[1]) >= link.separation.min_m) continue;
      return Error{fmt::format(
          "{}: drones {} and {} fly by onboard odometry from one place ({:.2f}, {:.2f}): say start_m of each, or "
          "common_frame = false of those that you keep apart by yourself",
          path, one.name, other.name, b[0], b[1])};
    }
  }
  return done;
}

Status check_pads(const std::string& path, const LinkSettings& link) {
  std::set<int> ids;
  for (const PadSettings& pad : link.pads) {
    if (!ids.insert(pad.id).second) return Error{fmt::format("{}: two [[pad]] have id {}", path, pad.id)};
  }
  const bool wanted = std::any_of(link.drones.begin(), link.drones.end(),
                                  [](const DroneSettings& drone) { return drone.source == PoseSource::pads; });
  if (wanted && link.pads.empty())
    return Error{fmt::format("{}: source \"pads\" needs a [[pad]] for each pad that lies there", path)};
  if (!wanted && !link.pads.empty())
    return Error{fmt::format("{}: [[pad]] goes with source \"pads\": no drone has it", path)};
  return done;
}

void read_drone_pose(Config& config, const std::string& key, const PoseSettings& pose, DroneSettings& drone) {
  drone.source = read_choice(config, {key + "pose_source", "pose.source of this drone", "pose.source"}, pose.source);
  drone.odometry = pose.odometry;
  drone.odometry_after_ns = pose.odometry_after_ns;
  const bool own = uses_odometry(drone.source);
  drone.velocity_known = pose.has_signs;
  if (own && !pose.has_signs && !config.is_describing()) {
    config.wrong("pose.velocity_signs",
                 fmt::format("must be there: drone {} flies by onboard odometry, or may, and with a wrong sign "
                             "it flies away; `ledgerline tello calibrate` measures them",
                             drone.name));
  }
  read_start(config, key, drone.odometry);
  drone.in_common_frame =
      config.boolean({key + "common_frame",
                      "its poses share the others' frame; if false, link does not keep it apart from them: you must"},
                     true);
  drone.by_hand_without_pose =
      config.boolean({key + "by_hand_without_pose",
                      "a pilot who sees it may fly it without a usable position, within the ceiling alone",
                      "true with onboard odometry alone"},
                     !uses_mocap(drone.source));
}

Status check_poses(const std::string& path, const LinkSettings& link) {
  for (const DroneSettings& drone : link.drones) {
    if (drone.source != PoseSource::mocap_then_tello || drone.odometry_after_ns < link.failsafe.pose_lost_ns) continue;
    return Error{
        fmt::format("{}: pose.odometry_after_ms must be less than failsafe.pose_lost_ms: drone {} would brake "
                    "before onboard odometry takes over",
                    path, drone.name)};
  }
  if (auto status = check_starts(path, link); !status) return status;
  return check_pads(path, link);
}

struct DroneTable {
  DroneSettings drone;
  std::string address, interface;
};

std::vector<DroneTable> read_drones(Config& config, const PoseSettings& pose, bool udp) {
  std::vector<DroneTable> tables;
  for (std::size_t i = 0; i < config.table_count({"drone", "1 to 16, one for each drone"}); ++i) {
    const std::string key = fmt::format("drone.{}.", i);
    DroneTable table;
    table.drone.name = config.text({key + "name", "as enrolled on the ledger"});
    if (!table.drone.name.empty() && !contract::is_drone_name(table.drone.name))
      config.wrong(key + "name", contract::drone_name_rule);
    table.drone.number = static_cast<DroneNumber>(
        config.integer({key + "number", "in shared memory; the same in agent.toml", "place in the file"},
                       static_cast<std::int64_t>(i) + 1, 1, max_drones));
    read_drone_pose(config, key, pose, table.drone);
    const Key address{key + "address", "IPv4, unique behind each interface; the shim goes by `number`"};
    table.address = udp ? config.text(address) : config.text(address, "");
    table.interface = config.text(
        {key + "interface",
         "network interface to the drone, such as wlan1; with one each, several drones may have 192.168.10.1"},
        "");
    table.drone.serial = config.text(
        {key + "serial", "required answer to `sn?` before take-off (`ledgerline tello find` shows it)"}, "");
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
  read_number(config, "separation.min_m", separation.min_m, 0, 10,
              "between drones of this host, centre to centre; 0: off. Larger needs more room to pass");
}

void read_track(Config& config, TrackSettings& track) {
  track.on_board = config.boolean({"track.on_board",
                                   "link holds drones to where their plans want them, and to their place; else plans' "
                                   "velocities alone are flown"},
                                  track.on_board);
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
  settings.summary = config.text({"output.summary", "JSON file of all counts, written at the end"}, "");
  settings.starts = config.text(
      {"output.starts", "file of link's last starts: if it keeps dying, the next start lands its drones"}, "");
  settings.local_stops = config.text({"output.local_stops",
                                      "file of drones that SIGTERM landed: they stay down until their owner's "
                                      "organisation clears the stop on the ledger, or link gets SIGUSR1"},
                                     "");
  settings.status_period_ms = config.integer(
      {"output.status_period_ms", "between JSON status lines on standard output; 0: none"}, 0, 0, 60'000);
}

}  // namespace

PoseSettings read_pose(Config& config) {
  PoseSettings pose;
  pose.source = read_choice(
      config,
      {"pose.source",
       "where poses come from: motion capture (or any topic of poses) through agent, the drone's velocities and "
       "heights, these and mission pads, or motion capture with onboard odometry in its gaps"},
      PoseSource::mocap);
  read_ms(
      config, "pose.odometry_after_ms", pose.odometry_after_ns, 20, 60'000,
      "with mocap+tello: onboard odometry takes over after so long without a pose; less than failsafe.pose_lost_ms");
  read_odometry(config, pose);
  read_pads(config, pose.pads);
  return pose;
}

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
  const auto commands_port =
      config.integer({"tello.command_port", "where drones take commands; fixed on a Tello"}, command_port, 1, 65535);
  const std::string port = std::to_string(commands_port);
  settings.state_port = static_cast<std::uint16_t>(config.integer(
      {"tello.state_port", "source port of state texts; those from another are ignored. 0: any", "tello.command_port"},
      commands_port, 0, 65535));
  const std::string listen =
      config.text({"state.listen", "IPv4:PORT for state texts; drones send to port 8890"}, "0.0.0.0:8890");
  read_number(config, "state.rate_hz", settings.link.rate_hz, 1, 200,
              "state samples a second of each drone, each answered by a command");
  read_output(config, settings);
  read_number(config, "realtime.loop_hz", settings.loop_hz, 100, 4000,
              "turns of the loop; a setpoint waits for at most one");
  settings.priority = static_cast<int>(config.integer(
      {"realtime.priority", "SCHED_FIFO, above agent's; 0: ordinary scheduling"}, settings.priority, 0, 98));
  settings.cpu =
      static_cast<int>(config.integer({"realtime.cpu", "core of the loop; -1: any"}, settings.cpu, -1, 1023));
  read_limits(config, settings.link.playout);
  read_playout(config, settings.link.playout);
  read_rc(config, settings.link.rc);
  read_failsafe(config, settings.link.failsafe);
  const bool fenced = read_fence(config, settings.link);
  read_separation(config, settings.link.separation);
  read_track(config, settings.link.track);
  for (const Status& status : {config.finish(), check_drones(path, tables, udp),
                               check_fence(path, settings.link.fence, fenced, real_drone(tables, udp)),
                               check_failsafe(path, settings.link.failsafe)}) {
    if (!status) return status.error();
  }

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
