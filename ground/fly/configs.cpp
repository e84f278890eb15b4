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
// command stays.
std::string patience(const Options& options) {
  if (both_ways(options) == 0) return "";
  constexpr TimeNs max_age_ns = 500 * ns_per_ms, silent_after_ns = ns_per_s;  // agent's defaults
  return fmt::format("\n[check]\nmax_age_ms = {:.0f}\n\n[agent]\nledger_silent_after_ms = {:.0f}\n",
                     to_ms(max_age_ns + both_ways(options)), to_ms(silent_after_ns + both_ways(options)));
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

}  // namespace

std::string user_dir(const RunFiles& files, int organisation, const std::string& user) {
  return fmt::format("{}/users/{}@org{}.ledgerline", organisation_dir(files, organisation), user, organisation);
}

Status write_sim_config(const RunFiles& files, const Options& options) {
  return write_file(files.config("sim"), dds_table(options, Side::drones));
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
                           drone_tables(options.drones, true);
  const std::string agent = ledger_table(files, endpoint, 1, "User1", ledger_keys(options)) + direct +
                            msp_tables(files) + output_table(files, "agent") + with_status + patience(options) +
                            dds_table(options, Side::drones) + drone_tables(options.drones, false);
  const std::string flight = fmt::format(
      "\n[flight]\nshape = \"{}\"\nspeed_mps = {:.3f}\nlaps = {}\nseconds = {:.3f}\nheight_m = {:.3f}\nside_m = "
      "{:.3f}\n",
      shape_name(options), options.speed_mps, options.laps, options.seconds, height_m, side_m);
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
