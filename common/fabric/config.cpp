#include "common/fabric/config.hpp"

#include <fmt/format.h>

#include <fstream>
#include <sstream>

namespace ledgerline::fabric {
namespace {

const Error incomplete{"keys of [ledger] or [[msp]] are missing or wrong"};

crypto::Library library_of(Config& config, const std::string& key, const std::string& otherwise) {
  const std::string name = config.choice(key, {"mbedtls", "libcrypto"}, otherwise);
  return name == "mbedtls" ? crypto::Library::mbedtls : crypto::Library::libcrypto;
}

}  // namespace

Result<ClientConfig> ledger_config(Config& config, std::chrono::milliseconds deadline) {
  ClientConfig out;
  out.endpoint = config.text("ledger.endpoint");
  out.tls_ca_file = config.text("ledger.tls_ca");
  out.server_name = config.text("ledger.server_name", "");
  out.where.channel = config.text("ledger.channel", out.where.channel);
  out.where.contract = config.text("ledger.contract", out.where.contract);
  out.max_in_flight = static_cast<std::size_t>(config.integer("ledger.max_in_flight", 64, 1, 10'000));
  out.deadline = std::chrono::milliseconds(config.integer("ledger.deadline_ms", deadline.count(), 100, 600'000));
  for (const auto& [table, servers] : {std::pair("orderer", &out.orderers), std::pair("peer", &out.other_peers)}) {
    const std::size_t count = config.table_count(table);
    for (std::size_t i = 0; i < count; ++i) {
      servers->push_back(
          {config.text(fmt::format("{}.{}.endpoint", table, i)), config.text(fmt::format("{}.{}.tls_ca", table, i))});
    }
  }
  out.cross_check = config.boolean("ledger.cross_check", out.cross_check);
  const std::string msp_id = config.text("ledger.msp_id");
  const std::string msp_dir = config.text("ledger.msp_dir");
  // libcrypto signs in a tenth of mbedTLS's time.
  const crypto::Library signer = library_of(config, "ledger.signer", "libcrypto");
  (void)library_of(config, "ledger.verifier", "libcrypto");
  if (out.endpoint.empty() || out.tls_ca_file.empty() || msp_id.empty() || msp_dir.empty()) return incomplete;
  auto identity = crypto::load_identity(signer, msp_id, msp_dir);
  if (!identity) return identity.error();
  out.identity = std::move(*identity);
  return out;
}

Result<std::unique_ptr<crypto::MspRegistry>> msp_registry(Config& config) {
  const crypto::Library verifier = library_of(config, "ledger.verifier", "libcrypto");
  // All keys first: what is not asked for would be reported as unknown.
  std::vector<std::pair<std::string, std::string>> named;
  bool complete = true;
  const std::size_t count = config.table_count("msp");
  for (std::size_t i = 0; i < count; ++i) {
    named.emplace_back(config.text(fmt::format("msp.{}.id", i)), config.text(fmt::format("msp.{}.ca", i)));
    complete = complete && !named.back().first.empty() && !named.back().second.empty();
  }
  if (named.empty()) return Error{"the config names no organisation to believe; add [[msp]] with id and ca"};
  if (!complete) return incomplete;
  std::vector<crypto::MspRoot> roots;
  for (const auto& [id, path] : named) {
    std::ifstream file(path);
    std::stringstream pem;
    pem << file.rdbuf();
    if (!file) return Error{fmt::format("cannot read the CA certificate {} of {}", path, id)};
    if (auto certificate = crypto::parse_certificate(pem.str()); !certificate) {
      return Error{fmt::format("{}: {}", path, certificate.error().what)};
    }
    roots.push_back({id, pem.str()});
  }
  return crypto::make_msp_registry(verifier, std::move(roots));
}

}  // namespace ledgerline::fabric
