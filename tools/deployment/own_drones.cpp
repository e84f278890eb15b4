#include "tools/deployment/own_drones.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <sstream>

#include "common/config/other_tables.hpp"
#include "common/msg/names.hpp"
#include "common/msg/onboard.hpp"
#include "common/msg/ros.hpp"
#include "onboard/link/shell/link_config.hpp"

namespace ledgerline::deployment {
namespace {

// That becomes a text of another TOML file as it stands.
std::string plain_text(Config& config, const Key& key, std::string text) {
  if (text.find_first_of("\"\\") != std::string::npos) config.wrong(key.name, "must have no quote and no backslash");
  return text;
}

std::vector<OwnDrone> read_each(Config& config) {
  const std::size_t count = config.table_count({"drone", "1 to 16 of them"});
  if (!config.is_describing() && (count == 0 || count > max_drones))
    config.wrong("drone", fmt::format("must be 1 to {} tables", max_drones));
  std::vector<OwnDrone> drones;
  std::set<std::string> names, ways;
  for (std::size_t i = 0; i < std::min<std::size_t>(count, max_drones); ++i) {
    const std::string key = fmt::format("drone.{}.", i);
    OwnDrone drone;
    const Key name{key + "name", "as enrolled on the ledger"};
    const Key behind{key + "interface", "for link's config, as its interface"};
    const Key serial{key + "serial", "required answer to `sn?`, for link's config"};
    drone.name = plain_text(config, name, config.text(name));
    drone.address = config.text({key + "address", "IPv4, as its host reaches it"});
    drone.interface = plain_text(config, behind, config.text(behind, ""));
    drone.serial = plain_text(config, serial, config.text(serial, ""));
    const auto start =
        config.numbers({key + "start_m", "where it stands, x, y, z in `map`, for onboard odometry"}, 3, {0, 0, 0});
    std::copy_n(start.begin(), std::min<std::size_t>(3, start.size()), drone.start_m.begin());
    drone.start_yaw_rad =
        config.number({key + "start_yaw_rad", "where its nose points then, counter-clockwise from x"}, 0, -7, 7);
    in_addr ip{};
    if (!drone.address.empty() && ::inet_pton(AF_INET, drone.address.c_str(), &ip) != 1)
      config.wrong(key + "address", fmt::format("is \"{}\", must be an IPv4 address", drone.address));
    if (!drone.name.empty() && !names.insert(drone.name).second)
      config.wrong(key + "name", "must be a name that no other has");
    if (!drone.address.empty() && !ways.insert(drone.interface + " " + drone.address).second)
      config.wrong(key + "address", "must be an address that no other drone behind the same interface has");
    drones.push_back(std::move(drone));
  }
  return drones;
}

// Of motion capture agent knows; of anything else link does, or refuses it.
void read_pose(Config& config, OwnDrones& out) {
  out.pose_source = config.text(
      {"pose.source", "as link's pose.source, with its [pose] keys; none: flown by hand (flight.shape manual)"});
  const Key topic_key{"pose.topic", "of mocap: as agent's mocap.topic, its default where this is \"\""};
  const Key clock_key{"pose.clock", "of mocap: as agent's mocap.clock, its default where this is \"\""};
  const std::string topic = plain_text(config, topic_key, config.text(topic_key, ""));
  const std::string clock = plain_text(config, clock_key, config.text(clock_key, ""));
  if (config.is_describing()) return;
  const auto known = from_name<link::PoseSource>(out.pose_source);
  if (!known && out.pose_source != "none" && !out.pose_source.empty()) {
    config.skip_table("pose");
    return config.wrong("pose.source", "must be one of mocap, tello, pads, mocap+tello, none");
  }
  if (known != link::PoseSource::mocap && out.pose_source != "none") {
    config.skip_table("pose");
    config.skip_table("pad");
    out.link_tables += config.table_text("pose", {"topic", "clock"}) + config.table_text("pad");
  }
  if (!known || !link::uses_mocap(*known)) {
    for (const auto& [key, value] : {std::pair("pose.topic", topic), std::pair("pose.clock", clock)}) {
      if (!value.empty()) config.wrong(key, "goes with pose.source = \"mocap\" or \"mocap+tello\"");
    }
    out.mocap_table = "\n[mocap]\ntopic = \"\"\n";
    return;
  }
  out.pose_topic = topic.empty() ? usual_pose_topic : topic;
  out.pose_stamps_count = clock != "arrival";
  if (!topic.empty()) out.mocap_table += fmt::format("topic = \"{}\"\n", topic);
  if (!clock.empty()) out.mocap_table += fmt::format("clock = \"{}\"\n", clock);
  if (!out.mocap_table.empty()) out.mocap_table.insert(0, "\n[mocap]\n");
}

// A drone without a fence, or with one that somebody else's room has, is dangerous: both corners are said.
void read_fence_and_limits(Config& config, OwnDrones& out) {
  link::read_bounds(config, out.link);
  if (config.is_describing()) return;
  for (const char* corner : {"fence.min_m", "fence.max_m"}) {
    if (config.numbers(corner, 3, {}).empty())
      config.wrong(corner, "must be there, x, y, z in m: real drones are not flown without a fence");
  }
  for (std::size_t i = 0; i < 3; ++i) {
    if (out.link.fence.min_m[i] >= out.link.fence.max_m[i])
      config.wrong("fence.min_m", fmt::format("must be below fence.max_m ({})", "xyz"[i]));
  }
  for (const char* table : {"fence", "rc", "limits"}) out.link_tables += config.table_text(table);
}

constexpr const char* existing = "existing";

/// The tables of one program's way to the ledger, from a file of their own.
struct LedgerFile {
  std::string tables, with_msp;
  std::string msp_id;
  crypto::IdentityFiles files;
};

/// What another file's reader found, a line each.
void wrong_in_file(Config& config, const std::string& key, const Status& read) {
  std::istringstream lines(read ? "" : read.error().message);
  for (std::string line; std::getline(lines, line);) config.wrong(key, line);
}

LedgerFile read_ledger_file(Config& config, const std::string& key, const std::string& path) {
  LedgerFile out;
  if (path.empty()) return out;
  auto file = Config::load(path);
  if (!file) {
    wrong_in_file(config, key, file.error());
    return out;
  }
  for (const char* table : {"ledger", "orderer", "endorser", "peer"}) out.tables += file->table_text(table);
  out.with_msp = out.tables + file->table_text("msp");
  out.msp_id = file->text("ledger.msp_id");
  const std::string msp_dir = file->text("ledger.msp_dir", "");
  out.files = {file->text("ledger.certificate", ""), file->text("ledger.private_key", "")};
  if (!msp_dir.empty()) {
    auto files = crypto::identity_files(msp_dir);
    if (!files) config.wrong(key, path + ": " + files.error().message);
    if (files) out.files = std::move(*files);
  }
  for (const char* table : {"ledger", "orderer", "endorser", "peer", "msp"}) file->skip_table(table);
  skip_other_tables(*file);  // of a host's whole agent.toml or ground.toml: the flight has its own
  wrong_in_file(config, key, file->finish());
  return out;
}

void read_own_ledger(Config& config, OwnDrones& out) {
  const std::string embedded = name_of(LedgerKind::embedded), fabric = name_of(LedgerKind::fabric);
  const std::string kind =
      config.choice({"ledger.kind", "embedded and fabric: started on this host; existing: it runs already"},
                    {embedded, fabric, existing}, embedded);
  const Key keys[] = {
      {"ledger.agent",
       "of kind \"existing\": agent.toml, for its [ledger], [[orderer]], [[endorser]], [[peer]], [[msp]]"},
      {"ledger.ground", "likewise ground's, whose identity acquires the drones"},
      {"ledger.admin", "likewise of who enrols agent for the drones; \"\": done already"}};
  std::string paths[3];
  for (std::size_t i = 0; i < 3; ++i) paths[i] = config.text(keys[i], "");
  if (config.is_describing()) return;
  if (kind != existing) {
    out.ledger = ledger_kind_of(kind);
    for (std::size_t i = 0; i < 3; ++i) {
      if (!paths[i].empty()) config.wrong(keys[i].name, "goes with ledger.kind = \"existing\"");
    }
    return;
  }
  for (std::size_t i = 0; i < 2; ++i) {
    if (paths[i].empty()) config.wrong(keys[i].name, "must be there with ledger.kind = \"existing\"");
  }
  const LedgerFile agent = read_ledger_file(config, keys[0].name, paths[0]);
  const LedgerFile ground = read_ledger_file(config, keys[1].name, paths[1]);
  const LedgerFile admin = read_ledger_file(config, keys[2].name, paths[2]);
  out.ledger = LedgerKind::fabric;
  out.network = OwnLedger{agent.with_msp, ground.with_msp, ground.tables, admin.tables,
                          agent.msp_id,   ground.msp_id,   agent.files,   ground.files};
}

void read_flight(Config& config, OwnDrones& out) {
  OwnFlight& flight = out.flight;
  flight.shape = config.text({"flight.shape", "as --shape: square, triangle, x, eight, a file of waypoints, manual"},
                             flight.shape);
  flight.side_m = config.number({"flight.side_m", "of the shape"}, flight.side_m, 0.5, 15);
  flight.speed_mps =
      config.number({"flight.speed_mps", "along the path; not above limits.speed_mps"}, flight.speed_mps, 0.05, 5);
  flight.wait_ns = from_seconds(config.number({"flight.wait_s", "for all drones to be there, or none takes off"},
                                              to_seconds(flight.wait_ns), 1, 600));
  const double lag_s = config.number(
      {"flight.lag_s", "of the drones' answer to a velocity, until learned in flight; 0: ground's default"}, 0, 0, 2);
  if (lag_s > 0) flight.lag_s = lag_s;
  flight.laps = static_cast<int>(config.integer({"flight.laps", "to fly"}, flight.laps, 1, 1000));
  if (!config.is_describing() && flight.speed_mps > static_cast<double>(out.link.playout.max_speed_mps))
    config.wrong("flight.speed_mps", "must not be above limits.speed_mps");
}

}  // namespace

bool is_of_own_drones(Config& config) {
  return config.table_count({"host", "a computer; none: drones that are there already, flown from this one"}) == 0;
}

namespace {

/// What a flight has measured counts as if it stood in this file.
void add_calibration(Config& config, const std::string& deployment) {
  const Key key{
      "calibration",
      "file of `ledgerline tello calibrate`, relative to this; its [rc], [pose] and [flight] count as here ([pose] for "
      "onboard odometry alone)"};
  const std::string path = config.text(key, "");
  if (path.empty()) return;
  auto measured = Config::load((std::filesystem::path(deployment).parent_path() / path).string());
  if (!measured) return wrong_in_file(config, key.name, measured.error());
  config.add_table(*measured, "rc");
  const auto source = from_name<link::PoseSource>(config.text("pose.source", ""));
  if (source && link::uses_odometry(*source)) config.add_table(*measured, "pose");
  config.add_table(*measured, "flight", {"full_scale_mps"});  // link's says it
  for (const char* table : {"rc", "pose", "flight"}) measured->skip_table(table);
  wrong_in_file(config, key.name, measured->finish());
}

/// What link's reader found in a text made of this file's tables, by this file's keys and lines.
void wrong_for_link(Config& config, const std::string& name, const Error& found) {
  std::istringstream lines(found.message);
  for (std::string line; std::getline(lines, line);) {
    if (const std::size_t colon = line.find(": "); line.starts_with(name) && colon != std::string::npos)
      line = line.substr(colon + 2);
    const std::size_t end = line.find(": ");
    const bool has_key = end != std::string::npos && line.find(' ') > end;
    config.wrong(has_key ? line.substr(0, end) : name, has_key ? line.substr(end + 2) : line);
  }
}

/// So that preflight finds what link would refuse at its start.
void check_as_link_does(Config& config, OwnDrones& own) {
  const std::string name = "for link";
  std::string text = own.link_tables;
  for (const OwnDrone& drone : own.drones)
    text += fmt::format(
        "\n[[drone]]\nname = \"{}\"\naddress = \"{}\"\ninterface = \"{}\"\nstart_m = [{}]\nstart_yaw_rad = {}\n",
        drone.name, drone.address, drone.interface, fmt::join(drone.start_m, ", "), drone.start_yaw_rad);
  auto links = Config::parse(text, name);
  const auto settings = links ? link::read_settings(*links, name) : links.error();
  if (!settings) return wrong_for_link(config, name, settings.error());
  own.link.drones = settings->link.drones;
}

}  // namespace

Result<OwnDrones> read_own_drones(Config& config, const std::string& path) {
  OwnDrones out;
  add_calibration(config, path);
  out.drones = read_each(config);
  read_own_ledger(config, out);
  read_pose(config, out);
  read_fence_and_limits(config, out);
  read_flight(config, out);
  if (auto status = config.finish(); !status) return status.error();
  check_as_link_does(config, out);
  if (auto status = config.finish(); !status) return status.error();
  return out;
}

}  // namespace ledgerline::deployment
