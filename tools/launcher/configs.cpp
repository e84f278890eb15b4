#include "tools/launcher/configs.hpp"

#include <fmt/format.h>
#include <unistd.h>
#include <algorithm>
#include <filesystem>
#include <functional>

#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "onboard/link/core/settings.hpp"
#include "sim/core/parameters.hpp"
#include "tools/configuration/config_file.hpp"
#include "tools/launcher/machine.hpp"
#include "tools/launcher/page_access.hpp"

namespace ledgerline::launcher {
namespace {

using configuration::ConfigFile;
using configuration::LedgerAccess;
using configuration::Server;

std::string organisation_dir(const RunFiles& files, int organisation) {
  return files.in(fmt::format("ledger/crypto/peerOrganizations/org{}.ledgerline", organisation));
}

std::string endorser_dir(const RunFiles& files) {
  return organisation_dir(files, 1) + "/peers/endorser0.org1.ledgerline";
}

// A slow ledger is what the user asked for.
TimeNs both_ways(const Options& options) {
  return fabric::both_ways_ns(options.batch_timeout_ns, static_cast<std::uint32_t>(options.batch_count));
}

std::string tls_ca(const RunFiles& files, int organisation) {
  return fmt::format("{}/tlsca/tlsca.org{}.ledgerline-cert.pem", organisation_dir(files, organisation), organisation);
}

std::string msp_id_of(int organisation) { return fmt::format("Org{}MSP", organisation); }

LedgerAccess access_of(const RunFiles& files, const std::string& endpoint, int organisation, const std::string& user) {
  return {.peer = {"", endpoint, "", tls_ca(files, 1)},
          .msp_id = msp_id_of(organisation),
          .msp_dir = user_dir(files, organisation, user) + "/msp",
          .config_block = files.in("ledger/teleop.block")};
}

Server endorser_of(const RunFiles& files, std::size_t organisation, const std::string& at) {
  const int number = static_cast<int>(organisation);
  return {msp_id_of(number), at, "", tls_ca(files, number)};
}

/// With a peer of each organisation, whose answers a receipt needs.
std::string control_config(const RunFiles& files, const LedgerEndpoints& endpoints, int organisation,
                           const std::string& user) {
  ConfigFile out;
  LedgerAccess access = access_of(files, endpoints.endpoint, organisation, user);
  for (std::size_t k = 1; k <= endpoints.peers.size(); ++k)
    access.endorsers.push_back(endorser_of(files, k, endpoints.peers[k - 1]));
  add_ledger(out, access);
  return out.plain();
}

void add_output(ConfigFile& out, const RunFiles& files, const std::string& program) {
  out.text("[output]", "trace", files.trace(program));
  out.text("[output]", "summary", files.summary(program));
}

// So that a peer cannot show a program that is started again an older chain. It goes with its ledger.
void add_checkpoint(ConfigFile& out, const RunFiles& files, const Options& options, const std::string& program) {
  const std::string directory = is_of_others(options) ? "" : "ledger/";
  out.text("[output]", "checkpoint", files.in(fmt::format("{}{}.checkpoint", directory, program)));
}

void add_status(ConfigFile& out) { out.number("[output]", "status_period_ms", 250); }

std::string vector_of(const std::array<double, 3>& v, const char* form) {
  return fmt::format("[{}, {}, {}]", fmt::format(fmt::runtime(form), v[0]), fmt::format(fmt::runtime(form), v[1]),
                     fmt::format(fmt::runtime(form), v[2]));
}

void add_service(ConfigFile& out, const RunFiles& files, const Options& options) {
  if (!options.watch) return;
  const ListenAddress at = options.listen.empty() ? ListenAddress{"127.0.0.1"} : *listen_address_from(options.listen);
  out.text("[service]", "listen", fmt::format("{}:{}", at.address, at.port > 0 ? at.port : free_port(at.address)));
  if (!options.listen.empty()) {
    out.text("[service]", "tls_certificate", files.in("page.pem"));
    out.text("[service]", "tls_key", files.in("page.key"));
  }
  out.text("[service]", "token_file", files.page_token());
  if (!options.operators.empty()) out.text("[service]", "operators", files.in("operators"));
  if (options.fault_switches) out.text("[service]", "faults", files.fault_switches());
  const link::FenceSettings fence = options.own ? options.own->link.fence : link::FenceSettings{};  // as link has it
  out.text("[mission]", "folder", files.in("missions"));
  out.number("[mission]", "approvals", options.approvals);
  out.text("[mission]", "after_restart", "go_on");
  out.add("[mission]", "fence_min_m", vector_of(fence.min_m, "{:g}"));
  out.add("[mission]", "fence_max_m", vector_of(fence.max_m, "{:g}"));
}

// Where the proxy stands for a drone.
std::string proxied_address_of(int drone) { return fmt::format("127.0.1.{}", drone + 1); }
const char* const proxy_address = "127.0.2.1";  // toward the drones; link has the ports for state at the others

void add_drones(ConfigFile& out, const Options& options) {
  for (int k = 1; k <= options.drones; ++k) {
    const auto index = static_cast<std::size_t>(k) - 1;
    out.text("[[drone]]", "name", drone_name(options, k), index);
    out.number("[[drone]]", "number", k, index);
  }
}

// Ground's, of which each may fly its own course.
void add_flown_drones(ConfigFile& out, const Options& options) {
  add_drones(out, options);
  for (const auto& [k, task] : options.tasks) {
    if (k > options.drones) continue;
    const auto index = static_cast<std::size_t>(k) - 1;
    out.text("[[drone]]", "shape", task.file.empty() ? ground::name_of(task.course.shape) : "waypoints", index);
    if (!task.file.empty()) out.text("[[drone]]", "waypoints", task.file, index);
    out.number("[[drone]]", "side_m", task.course.side_m, 3, index);
    out.number("[[drone]]", "speed_mps", task.course.speed_mps, 3, index);
    out.number("[[drone]]", "laps", task.course.laps, index);
  }
}

// A simulated one stands where the simulator puts it, so that those which fly by onboard odometry have one frame.
void add_links_drones(ConfigFile& out, const Options& options) {
  const sim::Parameters parameters;
  add_drones(out, options);
  for (int k = 1; k <= options.drones; ++k) {
    const auto index = static_cast<std::size_t>(k) - 1;
    const deployment::OwnDrone own =
        options.own ? options.own->drones[index]
                    : deployment::OwnDrone{.address = options.proxy ? proxied_address_of(k) : address_of(k),
                                           .start_m = sim::start_of(parameters, k)};
    out.text("[[drone]]", "address", own.address, index);
    out.add("[[drone]]", "start_m", vector_of(own.start_m, "{:.3f}"), index);
    out.number("[[drone]]", "start_yaw_rad", own.start_yaw_rad, 4, index);
    if (!own.interface.empty()) out.text("[[drone]]", "interface", own.interface, index);
    if (!own.serial.empty()) out.text("[[drone]]", "serial", own.serial, index);
    if (pose_of(options) == "none") out.add("[[drone]]", "by_hand_without_pose", "true", index);
  }
}

// One host's way to the ledger, through the proxy where there is one.
std::string endpoint_of(const Proxied& proxied, const std::string& name, const std::string& otherwise) {
  const auto found = proxied.find(name);
  return found == proxied.end() ? otherwise : found->second;
}
std::string orderer_name(const std::string& program, std::size_t i) {
  return fmt::format("{}-orderer{}", program, i + 1);
}

/// Over a connection: agent has one within.
bool asks_own_endorser(const Options& options, const LedgerEndpoints& endpoints, const std::string& program) {
  return !endpoints.own_endorser.empty() && !(options.endorser_within && program == "agent");
}
std::string own_endorser_name(const std::string& program) { return program + "-endorser"; }

std::string endorser_name(const std::string& program, std::size_t organisation) {
  return fmt::format("{}-endorser{}", program, organisation);
}

enum class Side { drones, ground };

// Said aloud, so that a CYCLONEDDS_URI in the shell does not open the drones' topics to a network.
void add_dds(ConfigFile& out, const Options& options, Side side) {
  if (!options.domains.empty()) out.number("[dds]", "domain", options.domains[side == Side::drones ? 0 : 1]);
  if (!options.ros_release.empty()) out.text("[dds]", "ros_release", options.ros_release);
  if (options.cyclonedds.empty())
    out.add("[dds]", "local_only", "true");
  else
    out.text("[dds]", "cyclonedds", options.cyclonedds);
}

// Without any pose, link waits for motion capture without result, and its drones may be flown by hand.
std::string source_for_link(const std::string& pose) { return pose == "none" ? "mocap" : pose; }

// What a deployment says of its own drones comes as it stands there.
std::string link_config(const RunFiles& files, const Options& options) {
  ConfigFile out;
  add_output(out, files, "link");
  // So that a link that dies and dies lands what it flies, and one that was asked to end keeps it down.
  out.text("[output]", "starts", files.in("link.starts"));
  out.text("[output]", "local_stops", files.in("link.stops"));
  if (options.own) add_status(out);
  out.number("[state]", "rate_hz", options.rate_hz, 3);
  // Link shares the port of state texts with nobody: at one address it leaves the others to a proxy.
  if (!options.own) out.text("[state]", "listen", "127.0.0.1:8890");
  // Link's own limit of 2 s for any command stays, unless a longer one was asked for. Ground counts on plans that take
  // over as they come; a pilot's are all for now, and smoothed.
  if (options.max_age_ns > link::PlayoutSettings{}.max_age_ns)
    out.number("[playout]", "max_age_ms", to_ms(options.max_age_ns), 0);
  if (!options.manual) out.number("[playout]", "max_margin_ms", 0);
  if (options.shim) {
    out.text("[tello]", "transport", "shim");
    out.text("[shim]", "memory", shim_memory(files));
  }
  if (options.own) {
    out.append(options.own->link_tables);
  } else {
    out.text("[pose]", "source", source_for_link(options.pose));
    out.add("[pose]", "velocity_signs", "[1, 1, 1]");
    for (std::size_t i = 0; i < options.pads.size(); ++i) {
      const sim::Pad& pad = options.pads[i];
      out.number("[[pad]]", "id", pad.id, i);
      out.add("[[pad]]", "position_m", fmt::format("[{:.3f}, {:.3f}, 0]", pad.x_m, pad.y_m), i);
      out.number("[[pad]]", "yaw_rad", pad.yaw_rad, 4, i);
    }
  }
  add_links_drones(out, options);
  return out.plain();
}

void add_flight(ConfigFile& out, const Options& options) {
  constexpr const char* table = "[flight]";
  out.text(table, "shape", shape_name(options));
  out.number(table, "speed_mps", options.speed_mps, 3);
  out.number(table, "laps", options.laps);
  out.number(table, "seconds", options.seconds, 3);
  out.number(table, "height_m", height_m, 3);
  out.number(table, "side_m", options.side_m, 3);
  out.add(table, "predict", fmt::format("{}", options.predict));
  // What link keeps to, as its own config leaves it.
  const link::LinkSettings link = options.own ? options.own->link : link::LinkSettings{};
  const bool mocap = source_for_link(pose_of(options)) == name(link::PoseSource::mocap);
  out.number(table, "full_scale_mps", std::min(link.rc.full_scale_mps, link.playout.max_speed_mps), 3);
  out.number(table, "max_acceleration_mps2", link.playout.max_acceleration_mps2, 3);
  if (options.own && options.own->flight.lag_s) out.number(table, "lag_s", *options.own->flight.lag_s, 3);
  out.number(table, "pose_lost_ms", to_ms(mocap ? link.failsafe.pose_lost_ns : link.failsafe.velocity_lost_ns), 0);
  if (!options.controller.empty()) out.text(table, "controller", options.controller);
  if (!options.course_file.empty()) out.text(table, "waypoints", options.course_file);
  if (options.ramp.start_mps > 0) {
    out.number(table, "ramp_start_mps", options.ramp.start_mps, 3);
    out.number(table, "ramp_step_mps", options.ramp.step_mps, 3);
  }
}

}  // namespace

deployment::Timeouts agents_timeouts(const Options& options) {
  return deployment::timeout_with(both_ways(options), options.max_age_ns);
}

std::string user_dir(const RunFiles& files, int organisation, const std::string& user) {
  return fmt::format("{}/users/{}@org{}.ledgerline", organisation_dir(files, organisation), user, organisation);
}

std::string shim_memory(const RunFiles& files) {
  return fmt::format("/dev/shm/ledgerline-{}-{:x}.shim", ::getpid(), std::hash<std::string>{}(files.directory));
}

Status write_sim_config(const RunFiles& files, const Options& options) {
  ConfigFile out;
  add_dds(out, options, Side::drones);
  return write_file(files.config("sim"), out.plain());
}

Status write_local_configs(const RunFiles& files, const Options& options) {
  ConfigFile local;
  add_output(local, files, "local");
  add_status(local);
  add_flight(local, options);
  add_dds(local, options, Side::drones);
  add_flown_drones(local, options);
  if (auto status = write_file(files.config("link"), link_config(files, options)); !status) return status;
  return write_file(files.config("local"), local.plain());
}

Status write_endorser_config(const RunFiles& files, const LedgerEndpoints& endpoints) {
  const std::string own = endorser_dir(files);
  LedgerAccess access = access_of(files, endpoints.endpoint, 1, "");
  access.msp_dir = own + "/msp";
  ConfigFile out;
  add_ledger(out, access);
  out.text("[serve]", "tls_certificate", own + "/tls/server.crt");
  out.text("[serve]", "tls_key", own + "/tls/server.key");
  out.text("[output]", "summary", files.summary("endorser"));
  return write_file(files.config("endorser"), out.plain());
}

Status write_proxy_config(const RunFiles& files, const Options& options, const LedgerEndpoints& endpoints) {
  ConfigFile out;
  out.add("[proxy]", "seed", std::to_string(options.seed));
  out.text("[proxy]", "faults", files.proxy_faults());
  out.text("[proxy]", "summary", files.summary(proxy_name));
  out.text("[proxy]", "source", proxy_address);
  for (int k = 1; k <= options.drones && !options.shim; ++k) {
    const auto at = static_cast<std::size_t>(k) - 1;
    out.text("[[drone]]", "name", fmt::format("tello{}", k), at);
    out.text("[[drone]]", "listen", proxied_address_of(k), at);
    out.text("[[drone]]", "address", address_of(k), at);
  }
  std::size_t servers = 0;
  const auto server = [&](const std::string& name, const std::string& address) {
    out.text("[[server]]", "name", name, servers);
    out.text("[[server]]", "listen", "127.0.0.1:0", servers);
    out.text("[[server]]", "address", address, servers++);
  };
  for (const std::string program : {"agent", "ground"}) {
    server(program, endpoints.endpoint);
    for (std::size_t i = 0; i < endpoints.orderers.size(); ++i) server(orderer_name(program, i), endpoints.orderers[i]);
    for (std::size_t k = 2; k <= endpoints.peers.size(); ++k) server(endorser_name(program, k), endpoints.peers[k - 1]);
    if (asks_own_endorser(options, endpoints, program)) server(own_endorser_name(program), endpoints.own_endorser);
  }
  return write_file(files.config(proxy_name), out.plain());
}

namespace {

/// Agent's and ground's way to a ledger that the flight has started.
LedgerAccess follower_access(const RunFiles& files, const Options& options, const LedgerEndpoints& endpoints,
                             const Proxied& proxied, const std::string& program) {
  LedgerAccess access =
      access_of(files, endpoint_of(proxied, program, endpoints.endpoint), program == "agent" ? 1 : 2, "User1");
  access.timeouts = deployment::timeout_with(both_ways(options));
  const std::string orderers_ca =
      options.ledger == Ledger::fabric
          ? files.in("ledger/crypto/ordererOrganizations/ledgerline/tlsca/tlsca.ledgerline-cert.pem")
          : tls_ca(files, 1);
  for (std::size_t i = 0; !options.gateway && i < endpoints.orderers.size(); ++i)
    access.orderers.push_back(
        {"", endpoint_of(proxied, orderer_name(program, i), endpoints.orderers[i]), "", orderers_ca});
  if (asks_own_endorser(options, endpoints, program))
    access.endorsers.push_back(
        endorser_of(files, 1, endpoint_of(proxied, own_endorser_name(program), endpoints.own_endorser)));
  for (std::size_t k = 1; !options.gateway && k <= endpoints.peers.size(); ++k)
    access.endorsers.push_back(
        endorser_of(files, k,
                    k == 1 ? endpoint_of(proxied, program, endpoints.endpoint)
                           : endpoint_of(proxied, endorser_name(program, k), endpoints.peers[k - 1])));
  for (int k = 1; k <= 3; ++k)
    access.msps.emplace_back(msp_id_of(k),
                             fmt::format("{}/ca/ca.org{}.ledgerline-cert.pem", organisation_dir(files, k), k));
  return access;
}

}  // namespace

Status write_configs(const RunFiles& files, const Options& options, const LedgerEndpoints& endpoints,
                     const Proxied& proxied) {
  if (!options.listen.empty()) {
    if (auto s = make_page_certificate(files, listen_address_from(options.listen)->address); !s) return s;
  }
  const deployment::OwnLedger* network = is_of_others(options) ? &*options.own->network : nullptr;
  // What both sides of the ledger have.
  const auto follower = [&](const std::string& program) {
    ConfigFile out;
    if (network) {
      out.append(program == "agent" ? network->agent : network->ground);
    } else {
      add_ledger(out, follower_access(files, options, endpoints, proxied, program));
      out.text("[ledger]", "blocks", options.blocks);
    }
    add_output(out, files, program);
    add_checkpoint(out, files, options, program);
    add_status(out);
    return out;
  };
  ConfigFile agent = follower("agent"), ground = follower("ground");
  // On a slow ledger a command may be older, and a quiet ledger is not yet a silent one.
  add_timeouts(agent, agents_timeouts(options));
  if (options.endorser_within) {
    const std::string own = endorser_dir(files);
    agent.text("[own_endorser]", "msp_dir", own + "/msp");
    agent.text("[own_endorser]", "listen", endpoints.own_endorser);
    agent.text("[own_endorser]", "tls_certificate", own + "/tls/server.crt");
    agent.text("[own_endorser]", "tls_key", own + "/tls/server.key");
    agent.text("[own_endorser]", "checkpoint", files.in("ledger/endorser.checkpoint"));
    agent.text("[own_endorser]", "summary", files.summary("endorser"));
  }
  if (options.own) agent.append(options.own->mocap_table);
  add_dds(agent, options, Side::drones);
  add_drones(agent, options);
  add_service(ground, files, options);
  add_flight(ground, options);
  add_dds(ground, options, Side::ground);
  add_flown_drones(ground, options);
  const std::pair<std::string, std::string> all[] = {
      {"link", link_config(files, options)},
      {"agent", agent.plain()},
      {"ground", ground.plain()},
      {"admin", network ? network->admin : control_config(files, endpoints, 1, "Admin")},
      {"operators-admin", network ? "" : control_config(files, endpoints, 2, "Admin")},
      {"operator", network ? network->pilot : control_config(files, endpoints, 2, "User1")},
  };
  for (const auto& [program, text] : all) {
    if (text.empty() || (program == "operators-admin" && options.operators.empty())) continue;
    if (auto status = write_file(files.config(program), text); !status) return status;
  }
  return done;
}

namespace {

namespace fs = std::filesystem;

constexpr std::size_t phrase_bytes = 8;  // PBKDF2 makes each guess cost some hundred milliseconds

Result<MadeOperator> make_operator(const RunFiles& files, const crypto::KeyAndCertificate& ca,
                                   const std::string& name) {
  MadeOperator made{.name = name,
                    .certificate = files.in(fmt::format("operators/{0}/signcerts/{0}-cert.pem", name)),
                    .pass_phrase = crypto::hex(crypto::random_bytes(phrase_bytes))};
  const auto issued = crypto::issue(
      ca, {.common_name = name + "@org2.ledgerline", .organization = "org2.ledgerline", .unit = "client", .sans = {}});
  if (!issued) return issued.error();
  const auto locked = crypto::lock_key(issued->key_pem, made.pass_phrase);
  if (!locked) return locked.error();
  const std::string folder = files.in("operators/" + name);
  for (const char* part : {"/signcerts", "/keystore"}) {
    std::error_code error;
    fs::create_directories(folder + part, error);
    if (error) return Error{fmt::format("{}{}: {}", folder, part, error.message())};
  }
  Status written = replace_file(made.certificate, issued->certificate_pem, 0644);
  if (written) written = replace_file(folder + "/keystore/priv_sk", *locked, 0600);
  if (!written) return written.error();
  return made;
}

}  // namespace

bool is_operator_name(const std::string& name) {
  constexpr std::size_t max_chars = 32;
  return !name.empty() && name.size() <= max_chars &&
         std::all_of(name.begin(), name.end(), [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); });
}

Result<std::vector<MadeOperator>> make_operators(const RunFiles& files, const std::vector<std::string>& names) {
  const std::string authority = files.in("ledger/crypto/peerOrganizations/org2.ledgerline/ca");
  const auto key = read_file(authority + "/priv_sk");
  const auto certificate = read_file(authority + "/ca.org2.ledgerline-cert.pem");
  if (!key || !certificate) return (key ? certificate : key).error();
  std::vector<MadeOperator> all;
  for (const std::string& name : names) {
    auto made = make_operator(files, {*key, *certificate}, name);
    if (!made) return Error{fmt::format("operator {}: {}", name, made.error().message)};
    all.push_back(std::move(*made));
  }
  return all;
}

}  // namespace ledgerline::launcher
