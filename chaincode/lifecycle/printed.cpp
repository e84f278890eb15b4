#include "chaincode/lifecycle/printed.hpp"

#include <fmt/format.h>

namespace ledgerline::chaincode_lifecycle {
namespace {

std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

std::string exported(const std::string& name, const std::string& value) {
  return fmt::format("export {}={}\n", name, quoted(value));
}

}  // namespace

std::string PeerCommands::environment() const {
  std::string out =
      exported("CORE_PEER_TLS_ENABLED", "true") + exported("CORE_PEER_LOCALMSPID", client.identity.name.msp_id) +
      exported("CORE_PEER_MSPCONFIGPATH", msp_dir.empty() ? "MSP_DIR" : msp_dir) +
      exported("CORE_PEER_ADDRESS", client.endpoint) + exported("CORE_PEER_TLS_ROOTCERT_FILE", client.tls_ca_file);
  if (!client.server_name.empty()) out += exported("CORE_PEER_TLS_SERVERHOSTOVERRIDE", client.server_name);
  if (!client.tls_pair.key_file.empty()) {
    out += exported("CORE_PEER_TLS_CLIENTAUTHREQUIRED", "true") +
           exported("CORE_PEER_TLS_CLIENTCERT_FILE", client.tls_pair.certificate_file) +
           exported("CORE_PEER_TLS_CLIENTKEY_FILE", client.tls_pair.key_file);
  }
  return out;
}

std::string PeerCommands::install(const std::string& package_file) const {
  return "peer lifecycle chaincode install " + quoted(package_file) + "\n";
}

std::string PeerCommands::to_orderer() const {
  const bool known = !client.orderers.empty();
  const fabric::ClientConfig::Server orderer =
      known ? client.orderers.front() : fabric::ClientConfig::Server{"ORDERER:7050", "ORDERER_TLS_CA.pem"};
  std::string out = fmt::format("-o {} --tls --cafile {}", quoted(orderer.endpoint), quoted(orderer.tls_ca_file));
  if (!orderer.server_name.empty()) out += " --ordererTLSHostnameOverride " + quoted(orderer.server_name);
  const auto& pair = orderer.tls_pair.key_file.empty() ? client.tls_pair : orderer.tls_pair;
  if (!pair.key_file.empty())
    out +=
        fmt::format(" --clientauth --certfile {} --keyfile {}", quoted(pair.certificate_file), quoted(pair.key_file));
  return out;
}

std::string PeerCommands::of(const Definition& definition) const {
  return fmt::format("--channelID {} --name {} --version {} --sequence {}", quoted(client.where.channel),
                     quoted(client.where.contract), quoted(definition.version), definition.sequence);
}

std::string PeerCommands::approve(const Definition& definition, const std::string& package_id) const {
  return fmt::format("peer lifecycle chaincode approveformyorg {} {} --package-id {}\n", to_orderer(), of(definition),
                     quoted(package_id));
}

std::string PeerCommands::commit(const Definition& definition) const {
  std::string out = fmt::format("peer lifecycle chaincode commit {} {} --peerAddresses {} --tlsRootCertFiles {}",
                                to_orderer(), of(definition), quoted(client.endpoint), quoted(client.tls_ca_file));
  for (const auto& endorser : client.endorsers) {
    if (endorser.endpoint == client.endpoint) continue;
    out += fmt::format(" --peerAddresses {} --tlsRootCertFiles {}", quoted(endorser.endpoint),
                       quoted(endorser.tls_ca_file));
  }
  if (client.endorsers.empty()) out += " --peerAddresses OTHER_PEER:7051 --tlsRootCertFiles OTHER_PEER_TLS_CA.pem";
  return out + "\n";
}

std::string PeerCommands::status() const {
  return fmt::format(
      "peer lifecycle chaincode queryinstalled\npeer lifecycle chaincode querycommitted --channelID {} --name {}\n",
      quoted(client.where.channel), quoted(client.where.contract));
}

}  // namespace ledgerline::chaincode_lifecycle
