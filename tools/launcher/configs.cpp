#include "tools/launcher/configs.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <functional>

#include "common/base/file.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "onboard/link/core/settings.hpp"
#include "sim/core/parameters.hpp"
#include "tools/deployment/timeouts.hpp"
#include "tools/launcher/machine.hpp"

namespace ledgerline::fly {
namespace {

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

std::string ledger_table(const RunFiles& files, const std::string& endpoint, int organisation, const std::string& user,
                         const std::string& more = {}) {
  return fmt::format("[ledger]\nendpoint = \"{}\"\ntls_ca = \"{}\"\nmsp_id = \"Org{}MSP\"\nmsp_dir = \"{}/msp\"\n{}\n",
                     endpoint, tls_ca(files, 1), organisation, user_dir(files, organisation, user), more);
}

std::string anchor_line(const RunFiles& files) {
  return fmt::format("config_block = \"{}\"\n", files.in("ledger/teleop.block"));
}

std::string msp_tables(const RunFiles& files) {
  std::string tables;
  for (int k = 1; k <= 3; ++k) {
    tables += fmt::format("[[msp]]\nid = \"Org{0}MSP\"\nca = \"{1}/ca/ca.org{0}.ledgerline-cert.pem\"\n\n", k,
                          organisation_dir(files, k));
  }
  return tables;
}

std::string output_table(const RunFiles& files, const std::string& program) {
  return fmt::format("[output]\ntrace = \"{}\"\nsummary = \"{}\"\n", files.trace(program), files.summary(program));
}

std::string service_table(const RunFiles& files, const Options& options) {
  if (!options.watch) return "";
  const std::string operators =
      options.operators.empty() ? "" : fmt::format("operators = \"{}\"\n", files.in("operators"));
  const std::string faults = options.fault_switches ? fmt::format("faults = \"{}\"\n", files.fault_switches()) : "";
  const link::FenceSettings fence = options.own ? options.own->link.fence : link::FenceSettings{};  // as link has it
  const auto corner = [](const auto& at_m) { return fmt::format("[{:g}, {:g}, {:g}]", at_m[0], at_m[1], at_m[2]); };
  return fmt::format(
      "\n[service]\nlisten = \"127.0.0.1:{}\"\ntoken_file = \"{}\"\n{}{}\n"
      "[mission]\nfolder = \"{}\"\napprovals = {}\nafter_restart = \"go_on\"\nfence_min_m = {}\nfence_max_m = {}\n\n",
      free_port(), files.page_token(), operators, faults, files.in("missions"), options.approvals, corner(fence.min_m),
      corner(fence.max_m));
}

// So that a link that dies and dies lands what it flies, and one that was asked to end keeps it down: more of [output].
std::string memory_lines(const RunFiles& files) {
  return fmt::format("starts = \"{}\"\nlocal_stops = \"{}\"\n", files.in("link.starts"), files.in("link.stops"));
}

// So that a peer cannot show a program that is started again an older chain: more of [output]. It goes with its ledger.
std::string checkpoint_line(const RunFiles& files, const Options& options, const std::string& program) {
  const std::string directory = is_of_others(options) ? "" : "ledger/";
  return fmt::format("checkpoint = \"{}\"\n", files.in(fmt::format("{}{}.checkpoint", directory, program)));
}

// Where the proxy stands for a drone.
std::string proxied_address_of(int drone) { return fmt::format("127.0.1.{}", drone + 1); }
const char* const proxy_address = "127.0.2.1";  // toward the drones; link has the ports for state at the others

std::string drone_tables(const Options& options) {
  std::string tables;
  for (int k = 1; k <= options.drones; ++k)
    tables += fmt::format("\n[[drone]]\nname = \"{}\"\nnumber = {}\n", drone_name(options, k), k);
  return tables;
}

// Ground's, of which each may fly its own course.
std::string flown_drone_tables(const Options& options) {
  std::string tables;
  for (int k = 1; k <= options.drones; ++k) {
    tables += fmt::format("\n[[drone]]\nname = \"{}\"\nnumber = {}\n", drone_name(options, k), k);
    if (!options.tasks.contains(k)) continue;
    const auto& [course, file] = options.tasks.at(k);
    tables += file.empty() ? fmt::format("shape = \"{}\"\n", ground::name_of(course.shape))
                           : fmt::format("shape = \"waypoints\"\nwaypoints = \"{}\"\n", file);
    tables +=
        fmt::format("side_m = {:.3f}\nspeed_mps = {:.3f}\nlaps = {}\n", course.side_m, course.speed_mps, course.laps);
  }
  return tables;
}

std::string pad_tables(const std::vector<sim::Pad>& pads) {
  std::string tables;
  for (const sim::Pad& pad : pads) {
    tables += fmt::format("\n[[pad]]\nid = {}\nposition_m = [{:.3f}, {:.3f}, 0]\nyaw_rad = {:.4f}\n", pad.id, pad.x_m,
                          pad.y_m, pad.yaw_rad);
  }
  return tables;
}

// A simulated one stands where the simulator puts it, so that those which fly by onboard odometry have one frame.
std::string link_drone_tables(const Options& options) {
  const sim::Parameters places;
  std::string tables;
  for (int k = 1; k <= options.drones; ++k) {
    const deployment::OwnDrone own =
        options.own ? options.own->drones[static_cast<std::size_t>(k) - 1]
                    : deployment::OwnDrone{.address = options.proxy ? proxied_address_of(k) : address_of(k),
                                           .start_m = sim::start_of(places, k)};
    tables += fmt::format(
        "\n[[drone]]\nname = \"{}\"\nnumber = {}\naddress = \"{}\"\nstart_m = [{:.3f}, {:.3f}, {:.3f}]\n"
        "start_yaw_rad = {:.4f}\n",
        drone_name(options, k), k, own.address, own.start_m[0], own.start_m[1], own.start_m[2], own.start_yaw_rad);
    if (!own.interface.empty()) tables += fmt::format("interface = \"{}\"\n", own.interface);
    if (!own.serial.empty()) tables += fmt::format("serial = \"{}\"\n", own.serial);
    if (pose_of(options) == "none") tables += "by_hand_without_pose = true\n";
  }
  return tables;
}

// One host's way to the ledger, through the proxy where there is one.
std::string place(const Proxied& proxied, const std::string& name, const std::string& otherwise) {
  const auto found = proxied.find(name);
  return found == proxied.end() ? otherwise : found->second;
}
std::string orderer_name(const std::string& program, std::size_t i) {
  return fmt::format("{}-orderer{}", program, i + 1);
}

std::string own_endorser_name(const std::string& program) { return program + "-endorser"; }

std::string endorser_name(const std::string& program, std::size_t organisation) {
  return fmt::format("{}-endorser{}", program, organisation);
}

enum class Side { drones, ground };

// Said aloud, so that a CYCLONEDDS_URI in the shell does not open the drones' topics to a network.
std::string dds_table(const Options& options, Side side) {
  std::string table = "\n[dds]\n";
  if (!options.domains.empty()) table += fmt::format("domain = {}\n", options.domains[side == Side::drones ? 0 : 1]);
  if (!options.ros_release.empty()) table += fmt::format("ros_release = \"{}\"\n", options.ros_release);
  return table + (options.cyclonedds.empty() ? "local_only = true\n"
                                             : fmt::format("cyclonedds = \"{}\"\n", options.cyclonedds));
}

// On a slow ledger a command may be older, and a quiet ledger is not yet a silent one. Link's own limit of 2 s for any
// command stays, unless a longer one was asked for.
std::string timeouts(const Options& options) {
  const TimeNs longer_ns = both_ways(options);
  if (longer_ns == 0 && options.max_age_ns == 0) return "";
  const deployment::Timeouts timeouts = deployment::timeout_with(longer_ns, options.max_age_ns);
  return fmt::format("\n[check]\nmax_age_ms = {:.0f}\n\n[agent]\nledger_silent_after_ms = {:.0f}\n",
                     to_ms(timeouts.max_age_ns), to_ms(timeouts.silent_after_ns));
}

// Ground counts on plans that take over as they come; a pilot's are all for now, and smoothed.
std::string playout_table(const Options& options) {
  const TimeNs link_max_age_ns = link::PlayoutSettings{}.max_age_ns;
  std::string table = "\n[playout]\n";
  if (options.max_age_ns > link_max_age_ns) table += fmt::format("max_age_ms = {:.0f}\n", to_ms(options.max_age_ns));
  if (!options.manual) table += "max_margin_ms = 0\n";
  return table;
}

// More of agent.toml.
std::string endorser_within(const RunFiles& files, const Options& options, const LedgerPlaces& places) {
  if (!options.endorser_within) return "";
  const std::string own = endorser_dir(files);
  return fmt::format(
      "\n[own_endorser]\nmsp_dir = \"{0}/msp\"\nlisten = \"{1}\"\ntls_certificate = \"{0}/tls/server.crt\"\ntls_key = "
      "\"{0}/tls/server.key\"\nsummary = \"{2}\"\n",
      own, places.own_endorser, files.summary("endorser"));
}

// Of agent's and ground's transactions.
std::string deadline(const Options& options) {
  if (both_ways(options) == 0) return "";
  return fmt::format("deadline_ms = {:.0f}\n", to_ms(deployment::timeout_with(both_ways(options)).deadline_ns));
}

// Without any pose, link waits for motion capture without result, and its drones may be flown by hand.
std::string source_for_link(const std::string& pose) { return pose == "none" ? "mocap" : pose; }

// Link shares the port of state texts with nobody: at one address it leaves the others to a proxy.
const char* const simulated_listen = "listen = \"127.0.0.1:8890\"\n";

// What a deployment says of its own drones comes as it stands there.
std::string link_config(const RunFiles& files, const Options& options) {
  return output_table(files, "link") + memory_lines(files) + (options.own ? "status_period_ms = 250\n" : "") +
         fmt::format("\n[state]\nrate_hz = {:.3f}\n{}", options.rate_hz, options.own ? "" : simulated_listen) +
         playout_table(options) +
         (options.shim ? fmt::format("\n[tello]\ntransport = \"shim\"\n\n[shim]\nmemory = \"{}\"\n", shim_memory(files))
                       : "") +
         (options.own
              ? "\n" + options.own->link_tables
              : fmt::format("\n[pose]\nsource = \"{}\"\nvelocity_signs = [1, 1, 1]\n", source_for_link(options.pose)) +
                    pad_tables(options.pads)) +
         link_drone_tables(options);
}

std::string flight_table(const Options& options) {
  std::string table = fmt::format(
      "\n[flight]\nshape = \"{}\"\nspeed_mps = {:.3f}\nlaps = {}\nseconds = {:.3f}\nheight_m = {:.3f}\nside_m = "
      "{:.3f}\npredict = {}\n",
      shape_name(options), options.speed_mps, options.laps, options.seconds, height_m, options.side_m, options.predict);
  // What link keeps to, as its own config leaves it.
  const link::LinkSettings link = options.own ? options.own->link : link::LinkSettings{};
  const bool mocap = source_for_link(pose_of(options)) == name(link::PoseSource::mocap);
  table += fmt::format("full_scale_mps = {:.3f}\nmax_acceleration_mps2 = {:.3f}\npose_lost_ms = {:.0f}\n",
                       std::min(link.rc.full_scale_mps, link.playout.max_speed_mps), link.playout.max_acceleration_mps2,
                       to_ms(mocap ? link.failsafe.pose_lost_ns : link.failsafe.velocity_lost_ns));
  if (!options.controller.empty()) table += fmt::format("controller = \"{}\"\n", options.controller);
  if (!options.course_file.empty()) table += fmt::format("waypoints = \"{}\"\n", options.course_file);
  if (options.ramp.start_mps > 0) {
    table +=
        fmt::format("ramp_start_mps = {:.3f}\nramp_step_mps = {:.3f}\n", options.ramp.start_mps, options.ramp.step_mps);
  }
  return table;
}

}  // namespace

std::string user_dir(const RunFiles& files, int organisation, const std::string& user) {
  return fmt::format("{}/users/{}@org{}.ledgerline", organisation_dir(files, organisation), user, organisation);
}

std::string shim_memory(const RunFiles& files) {
  return fmt::format("/dev/shm/ledgerline-{}-{:x}.shim", ::getpid(), std::hash<std::string>{}(files.directory));
}

Status write_sim_config(const RunFiles& files, const Options& options) {
  return write_file(files.config("sim"), dds_table(options, Side::drones));
}

Status write_local_configs(const RunFiles& files, const Options& options) {
  const std::string link = link_config(files, options);
  const std::string local = output_table(files, "local") + "status_period_ms = 250\n" + flight_table(options) +
                            dds_table(options, Side::drones) + flown_drone_tables(options);
  if (auto status = write_file(files.config("link"), link); !status) return status;
  return write_file(files.config("local"), local);
}

Status write_endorser_config(const RunFiles& files, const LedgerPlaces& places) {
  const std::string own = endorser_dir(files);
  return write_file(
      files.config("endorser"),
      fmt::format("[ledger]\nendpoint = \"{}\"\ntls_ca = \"{}\"\nmsp_id = \"Org1MSP\"\nmsp_dir = "
                  "\"{}/msp\"\n{}\n[serve]\ntls_certificate = \"{}/tls/server.crt\"\ntls_key = "
                  "\"{}/tls/server.key\"\n\n[output]\nsummary = \"{}\"\n",
                  places.endpoint, tls_ca(files, 1), own, anchor_line(files), own, own, files.summary("endorser")));
}

Status write_proxy_config(const RunFiles& files, const Options& options, const LedgerPlaces& places) {
  std::string text = fmt::format("[proxy]\nseed = {}\nfaults = \"{}\"\nsummary = \"{}\"\nsource = \"{}\"\n",
                                 options.seed, files.proxy_faults(), files.summary(proxy_name), proxy_address);
  for (int k = 1; k <= options.drones && !options.shim; ++k) {
    text += fmt::format("\n[[drone]]\nname = \"tello{}\"\nlisten = \"{}\"\naddress = \"{}\"\n", k,
                        proxied_address_of(k), address_of(k));
  }
  const auto server = [&](const std::string& name, const std::string& address) {
    text += fmt::format("\n[[server]]\nname = \"{}\"\nlisten = \"127.0.0.1:0\"\naddress = \"{}\"\n", name, address);
  };
  for (const std::string program : {"agent", "ground"}) {
    server(program, places.endpoint);
    for (std::size_t i = 0; i < places.orderers.size(); ++i) server(orderer_name(program, i), places.orderers[i]);
    for (std::size_t k = 2; k <= places.peers.size(); ++k) server(endorser_name(program, k), places.peers[k - 1]);
    if (!places.own_endorser.empty()) server(own_endorser_name(program), places.own_endorser);
  }
  return write_file(files.config(proxy_name), text);
}

Status write_configs(const RunFiles& files, const Options& options, const LedgerPlaces& places,
                     const Proxied& proxied) {
  const std::string& endpoint = places.endpoint;
  const std::vector<std::string>& orderers = places.orderers;
  const auto endorser = [&](int organisation, const std::string& at) {
    return fmt::format("[[endorser]]\nmsp_id = \"Org{}MSP\"\nendpoint = \"{}\"\ntls_ca = \"{}\"\n\n", organisation, at,
                       tls_ca(files, organisation));
  };
  const auto direct = [&](const std::string& program) {
    std::string tables;
    for (std::size_t i = 0; !options.gateway && i < orderers.size(); ++i) {
      tables += fmt::format("[[orderer]]\nendpoint = \"{}\"\ntls_ca = \"{}\"\n\n",
                            place(proxied, orderer_name(program, i), orderers[i]),
                            files.in("ledger/crypto/ordererOrganizations/ledgerline/tlsca/tlsca.ledgerline-cert.pem"));
    }
    if (!places.own_endorser.empty() && !(options.endorser_within && program == "agent"))
      tables += endorser(1, place(proxied, own_endorser_name(program), places.own_endorser));
    for (std::size_t k = 1; !options.gateway && k <= places.peers.size(); ++k) {
      const std::string at = k == 1 ? place(proxied, program, places.endpoint)
                                    : place(proxied, endorser_name(program, k), places.peers[k - 1]);
      tables += endorser(static_cast<int>(k), at);
    }
    return tables;
  };
  const deployment::OwnLedger* network = is_of_others(options) ? &*options.own->network : nullptr;
  const auto ledger = [&](const std::string& program, int organisation) {
    if (network) return (program == "agent" ? network->agent : network->ground) + "\n";
    return ledger_table(files, place(proxied, program, endpoint), organisation, "User1",
                        anchor_line(files) + fmt::format("blocks = \"{}\"\n", options.blocks) + deadline(options)) +
           direct(program) + msp_tables(files);
  };
  const std::string with_status = "status_period_ms = 250\n";
  const std::string link = link_config(files, options);
  const std::string agent = ledger("agent", 1) + output_table(files, "agent") +
                            checkpoint_line(files, options, "agent") + with_status + timeouts(options) +
                            endorser_within(files, options, places) + (options.own ? options.own->mocap_table : "") +
                            dds_table(options, Side::drones) + drone_tables(options);
  const std::string ground = ledger("ground", 2) + output_table(files, "ground") +
                             checkpoint_line(files, options, "ground") + with_status + service_table(files, options) +
                             flight_table(options) + dds_table(options, Side::ground) + flown_drone_tables(options);
  const std::pair<std::string, std::string> all[] = {
      {"link", link},
      {"agent", agent},
      {"ground", ground},
      {"admin", network ? network->admin : ledger_table(files, endpoint, 1, "Admin", anchor_line(files))},
      {"operators-admin", network ? "" : ledger_table(files, endpoint, 2, "Admin", anchor_line(files))},
      {"operator", network ? network->pilot : ledger_table(files, endpoint, 2, "User1", anchor_line(files))},
  };
  for (const auto& [program, text] : all) {
    if (program == "operators-admin" && options.operators.empty()) continue;
    if (auto status = write_file(files.config(program), text); !status) return status;
  }
  return done;
}

}  // namespace ledgerline::fly
