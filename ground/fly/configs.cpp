#include "ground/fly/configs.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/rt/file.hpp"
#include "ground/fly/machine.hpp"

namespace ledgerline::fly {
namespace {

std::string organisation_dir(const RunFiles& files, int organisation) {
  return files.in(fmt::format("ledger/crypto/peerOrganizations/org{}.ledgerline", organisation));
}

// A slow ledger is the user's wish.
TimeNs both_ways(const Options& options) {
  return options.batch_count == 1 ? 0 : std::min(2 * options.batch_timeout_ns, 55 * ns_per_s);  // 1: a block at once
}

std::string ledger_table(const RunFiles& files, const std::string& endpoint, int organisation, const std::string& user,
                         const std::string& more = {}) {
  return fmt::format(
      "[ledger]\nendpoint = \"{}\"\ntls_ca = \"{}/tlsca/tlsca.org1.ledgerline-cert.pem\"\n"
      "msp_id = \"Org{}MSP\"\nmsp_dir = \"{}/msp\"\n{}\n",
      endpoint, organisation_dir(files, 1), organisation, user_dir(files, organisation, user), more);
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

std::string drone_tables(int drones, bool with_address) {
  std::string tables;
  for (int k = 1; k <= drones; ++k) {
    tables += fmt::format("\n[[drone]]\nname = \"tello{0}\"\nnumber = {0}\n", k);
    if (with_address) tables += fmt::format("address = \"{}\"\n", address_of(k));
  }
  return tables;
}

enum class Side { drones, ground };

std::string dds_table(const Options& options, Side side) {
  if (options.domains.empty()) return "";
  return fmt::format("\n[dds]\ndomain = {}\n", options.domains[side == Side::drones ? 0 : 1]);
}

// On a slow ledger a command may be older, and a quiet ledger is not yet a silent one. Link's own limit of 2 s for any
// command stays, unless a longer one was asked for.
std::string patience(const Options& options) {
  const TimeNs longer_ns = both_ways(options);
  if (longer_ns == 0 && options.max_age_ns == 0) return "";
  constexpr TimeNs max_age_ns = 500 * ns_per_ms, silent_after_ns = ns_per_s;  // agent's defaults
  return fmt::format("\n[check]\nmax_age_ms = {:.0f}\n\n[agent]\nledger_silent_after_ms = {:.0f}\n",
                     to_ms(options.max_age_ns > 0 ? options.max_age_ns : max_age_ns + longer_ns),
                     to_ms(silent_after_ns + std::max(longer_ns, options.max_age_ns)));
}

// Ground counts on plans that take over as they come; a pilot's are all for now, and smoothed.
std::string playout_table(const Options& options) {
  constexpr TimeNs link_max_age_ns = 2 * ns_per_s;
  std::string table = "\n[playout]\n";
  if (options.max_age_ns > link_max_age_ns) table += fmt::format("max_age_ms = {:.0f}\n", to_ms(options.max_age_ns));
  if (!options.manual) table += "max_margin_ms = 0\n";
  return table;
}

// Of agent's and ground's transactions.
std::string deadline(const Options& options) {
  if (both_ways(options) == 0) return "";
  constexpr TimeNs deadline_ns = ns_per_s;  // their default
  return fmt::format("deadline_ms = {:.0f}\n", to_ms(deadline_ns + both_ways(options)));
}

// What both sides of the ledger add to their [ledger].
std::string ledger_keys(const Options& options) {
  return deadline(options) +
         fmt::format("signer = \"{0}\"\nverifier = \"{0}\"\n", options.mbedtls ? "mbedtls" : "libcrypto");
}

std::string flight_table(const Options& options) {
  std::string table = fmt::format(
      "\n[flight]\nshape = \"{}\"\nspeed_mps = {:.3f}\nlaps = {}\nseconds = {:.3f}\nheight_m = {:.3f}\nside_m = "
      "{:.3f}\npredict = {}\n",
      shape_name(options), options.speed_mps, options.laps, options.seconds, height_m, options.side_m, options.predict);
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

Status write_sim_config(const RunFiles& files, const Options& options) {
  return write_file(files.config("sim"), dds_table(options, Side::drones));
}

Status write_local_configs(const RunFiles& files, const Options& options) {
  const std::string link = output_table(files, "link") + fmt::format("\n[state]\nrate_hz = {:.3f}\n", options.rate_hz) +
                           playout_table(options) + drone_tables(options.drones, true);
  const std::string local = output_table(files, "local") + "status_period_ms = 250\n" + flight_table(options) +
                            dds_table(options, Side::drones) + drone_tables(options.drones, false);
  if (auto status = write_file(files.config("link"), link); !status) return status;
  return write_file(files.config("local"), local);
}

Status write_configs(const RunFiles& files, const Options& options, const std::string& endpoint,
                     const std::vector<std::string>& orderers) {
  std::string direct;
  // The direct path carries one endorsement: a majority is the gateway's.
  const bool past_gateway = !options.gateway && !options.majority;
  for (const std::string& orderer : past_gateway ? orderers : std::vector<std::string>()) {
    direct += fmt::format("[[orderer]]\nendpoint = \"{}\"\ntls_ca = \"{}\"\n\n", orderer,
                          files.in("ledger/crypto/ordererOrganizations/ledgerline/tlsca/tlsca.ledgerline-cert.pem"));
  }
  const std::string with_status = "status_period_ms = 250\n";
  const std::string link = output_table(files, "link") + fmt::format("\n[state]\nrate_hz = {:.3f}\n", options.rate_hz) +
                           playout_table(options) + drone_tables(options.drones, true);
  const std::string agent = ledger_table(files, endpoint, 1, "User1", ledger_keys(options)) + direct +
                            msp_tables(files) + output_table(files, "agent") + with_status + patience(options) +
                            dds_table(options, Side::drones) + drone_tables(options.drones, false);
  const std::string flight = flight_table(options);
  const std::string ground = ledger_table(files, endpoint, 2, "User1", ledger_keys(options)) + direct +
                             msp_tables(files) + output_table(files, "ground") + with_status + flight +
                             dds_table(options, Side::ground) + drone_tables(options.drones, false);
  const std::pair<std::string, std::string> all[] = {
      {"link", link},
      {"agent", agent},
      {"ground", ground},
      {"admin", ledger_table(files, endpoint, 1, "Admin")},
      {"operator", ledger_table(files, endpoint, 2, "User1")},
  };
  for (const auto& [program, text] : all) {
    if (auto status = write_file(files.config(program), text); !status) return status;
  }
  return done;
}

}  // namespace ledgerline::fly
