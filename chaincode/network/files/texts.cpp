#include "chaincode/network/options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "chaincode/identities/identities.hpp"
#include "chaincode/lifecycle/lifecycle.hpp"

namespace ledgerline::network {
namespace {

using identities::domain_of;
using identities::msp_id_of;

constexpr const char* orderer_msp = "OrdererMSP";

// Plain where it can be; else in quotes, as JSON and YAML have them alike.
std::string yaml_text(const std::string& path) {
  const bool plain = std::ranges::all_of(path, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           std::string_view("/._-@+").find(c) != std::string_view::npos;
  });
  return plain ? path : nlohmann::json(path).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string organisation_yaml(const std::string& name, const std::string& msp_dir, const std::string& more) {
  return fmt::format(R"yaml(  - &{0}
    Name: {0}
    ID: {0}
    MSPDir: {1}
    Policies:
      Readers: {{Type: Signature, Rule: "OR('{0}.member')"}}
      Writers: {{Type: Signature, Rule: "OR('{0}.member')"}}
      Admins: {{Type: Signature, Rule: "OR('{0}.admin')"}}
      Endorsement: {{Type: Signature, Rule: "OR('{0}.peer')"}}
{2})yaml",
                     name, yaml_text(msp_dir), more);
}

std::string implicit(const std::string& rule) { return fmt::format("{{Type: ImplicitMeta, Rule: \"{}\"}}", rule); }

/// Of organisations as one Signature policy, which costs one verification of the creator's signature. "ANY Writers"
/// tries the organisations' own policies one after the other, in an order that each process draws at its start, and
/// each of them verifies again.
std::string any_member(const std::vector<std::string>& msp_ids) {
  std::string members;
  for (const std::string& id : msp_ids) members += fmt::format("{}'{}.member'", members.empty() ? "" : ", ", id);
  return fmt::format("{{Type: Signature, Rule: \"OR({})\"}}", members);
}

std::string policies(int indent, const std::string& writers,
                     const std::vector<std::pair<std::string, std::string>>& more) {
  std::vector<std::pair<std::string, std::string>> all{
      {"Readers", implicit("ANY Readers")}, {"Writers", writers}, {"Admins", implicit("MAJORITY Admins")}};
  all.insert(all.end(), more.begin(), more.end());
  std::string text;
  for (const auto& [name, policy] : all) text += fmt::format("{:{}}{}: {}\n", "", indent, name, policy);
  return text;
}

std::string tls_file(const std::filesystem::path& member, const char* name) { return member / "tls" / name; }

}  // namespace

std::string configtx_yaml(const Options& options, const ListenAddresses& addresses) {
  std::string organisations, members, endpoints, consenters;
  std::vector<std::string> application;
  for (int k = 1; k <= options.orderers; ++k) {
    const auto dir = identities::orderer_dir(options.dir, k);
    const ListenAddress& address = addresses.orderers[static_cast<std::size_t>(k - 1)];
    endpoints += fmt::format("      - {}\n", addresses.orderer(k));
    consenters +=
        fmt::format("        - {{Host: {}, Port: {}, ClientTLSCert: {}, ServerTLSCert: {}}}\n", address.host,
                    address.port, yaml_text(tls_file(dir, "server.crt")), yaml_text(tls_file(dir, "server.crt")));
  }
  organisations += organisation_yaml(orderer_msp, identities::ordering_dir(options.dir) / "msp",
                                     "    OrdererEndpoints:\n" + endpoints);
  for (int k = 1; k <= identities::organisations; ++k) {
    const ListenAddress& address = addresses.organisations[static_cast<std::size_t>(k - 1)];
    organisations += organisation_yaml(
        msp_id_of(k), identities::organisation_dir(options.dir, k) / "msp",
        fmt::format("    AnchorPeers:\n      - {{Host: {}, Port: {}}}\n", address.host, address.port));
    members += fmt::format("        - *{}\n", msp_id_of(k));
    application.push_back(msp_id_of(k));
  }
  std::vector<std::string> everybody = application;
  everybody.insert(everybody.begin(), orderer_msp);
  // With MaxInflightBlocks in Raft's hands the leader takes no transaction; Fabric's default of 5 is a burst of five
  // where each has a block of its own. A leader that is gone is missed after 1 s (Raft's ElectionTick x TickInterval).
  return fmt::format(
      R"yaml(Organizations:
{organisations}Profiles:
  Ledgerline:
    Policies:
{policies}    Capabilities: {{V2_0: true}}
    Orderer:
      OrdererType: etcdraft
      BatchTimeout: {timeout_us}us
      BatchSize: {{MaxMessageCount: {count}, AbsoluteMaxBytes: 10 MB, PreferredMaxBytes: {bytes}}}
      EtcdRaft:
        Consenters:
{consenters}        Options: {{TickInterval: 100ms, ElectionTick: 10, HeartbeatTick: 1, MaxInflightBlocks: 50, SnapshotIntervalSize: 8 MB}}
      Organizations:
        - *OrdererMSP
      Policies:
{ordering_policies}      Capabilities: {{V2_0: true}}
    Application:
      Organizations:
{members}      Policies:
{application_policies}      Capabilities: {{V2_5: true}}
)yaml",
      fmt::arg("organisations", organisations), fmt::arg("policies", policies(6, any_member(everybody), {})),
      fmt::arg("timeout_us", options.batch_timeout_ns / ns_per_us), fmt::arg("count", options.batch_count),
      fmt::arg("bytes", options.batch_bytes), fmt::arg("consenters", consenters), fmt::arg("members", members),
      fmt::arg("ordering_policies",
               policies(8, implicit("ANY Writers"), {{"BlockValidation", implicit("ANY Writers")}})),
      fmt::arg("application_policies", policies(8, any_member(application),
                                                {{"LifecycleEndorsement", implicit("MAJORITY Endorsement")},
                                                 {"Endorsement", implicit("MAJORITY Endorsement")}})));
}

std::vector<std::string> orderer_environment(const Options& options, const ListenAddresses& addresses, int number) {
  const auto own = identities::orderer_dir(options.dir, number);
  const ListenAddress& address = addresses.orderers[static_cast<std::size_t>(number - 1)];
  const std::string data = fmt::format("{}/orderer{}", options.dir, number);
  const std::string key = tls_file(own, "server.key"), certificate = tls_file(own, "server.crt"),
                    ca = tls_file(own, "ca.crt");
  return {"FABRIC_CFG_PATH=" + options.tools + "/config", "FABRIC_LOGGING_SPEC=warn",
          "ORDERER_GENERAL_LISTENADDRESS=" + address.host, fmt::format("ORDERER_GENERAL_LISTENPORT={}", address.port),
          fmt::format("ORDERER_GENERAL_LOCALMSPID={}", orderer_msp),
          "ORDERER_GENERAL_LOCALMSPDIR=" + (own / "msp").string(), "ORDERER_GENERAL_BOOTSTRAPMETHOD=none",
          "ORDERER_GENERAL_TLS_ENABLED=true", "ORDERER_GENERAL_TLS_PRIVATEKEY=" + key,
          "ORDERER_GENERAL_TLS_CERTIFICATE=" + certificate, "ORDERER_GENERAL_TLS_ROOTCAS=[" + ca + "]",
          "ORDERER_GENERAL_CLUSTER_CLIENTPRIVATEKEY=" + key, "ORDERER_GENERAL_CLUSTER_CLIENTCERTIFICATE=" + certificate,
          "ORDERER_GENERAL_CLUSTER_ROOTCAS=[" + ca + "]",
          // A leader that is gone holds up what is forwarded to it for as long.
          "ORDERER_GENERAL_CLUSTER_RPCTIMEOUT=1s", "ORDERER_GENERAL_CLUSTER_DIALTIMEOUT=1s",
          "ORDERER_CHANNELPARTICIPATION_ENABLED=true", "ORDERER_ADMIN_LISTENADDRESS=" + addresses.orderer_admin(number),
          "ORDERER_ADMIN_TLS_ENABLED=true", "ORDERER_ADMIN_TLS_PRIVATEKEY=" + key,
          "ORDERER_ADMIN_TLS_CERTIFICATE=" + certificate, "ORDERER_ADMIN_TLS_ROOTCAS=[" + ca + "]",
          "ORDERER_ADMIN_TLS_CLIENTAUTHREQUIRED=true", "ORDERER_ADMIN_TLS_CLIENTROOTCAS=[" + ca + "]",
          "ORDERER_OPERATIONS_LISTENADDRESS=" + addresses.orderer_operations(number),
          "ORDERER_METRICS_PROVIDER=prometheus",  // who leads is said there alone
          "ORDERER_FILELEDGER_LOCATION=" + data + "/ledger", "ORDERER_CONSENSUS_WALDIR=" + data + "/wal",
          "ORDERER_CONSENSUS_SNAPDIR=" + data + "/snapshots"};
}

std::vector<std::string> peer_environment(const Options& options, const ListenAddresses& addresses, int organisation) {
  const auto own = identities::peer_dir(options.dir, organisation);
  const std::string data = fmt::format("{}/peer{}", options.dir, organisation);
  const std::string listen = addresses.peer(organisation);
  // Gossip looks for the other peers once a second: until one that was started again knows them, its gateway finds
  // nobody to endorse as a second one. A peer whose orderers were gone for an hour would, by Fabric's default, ask them
  // again ten minutes later. One that has 2 x blockBufferSize blocks to commit (Fabric's default: 40) sleeps 100 ms for
  // each more.
  return {"FABRIC_CFG_PATH=" + options.tools + "/config",
          "FABRIC_LOGGING_SPEC=warn",
          "CORE_PEER_ID=peer0." + domain_of(organisation),
          "CORE_PEER_NETWORKID=ledgerline",
          "CORE_PEER_ADDRESS=" + listen,
          "CORE_PEER_LISTENADDRESS=" + listen,
          "CORE_PEER_CHAINCODELISTENADDRESS=" + addresses.peer_chaincode(organisation),
          "CORE_PEER_LOCALMSPID=" + msp_id_of(organisation),
          "CORE_PEER_MSPCONFIGPATH=" + (own / "msp").string(),
          "CORE_PEER_FILESYSTEMPATH=" + data,
          "CORE_LEDGER_SNAPSHOTS_ROOTDIR=" + data + "/snapshots",
          fmt::format("CORE_LEDGER_HISTORY_ENABLEHISTORYDATABASE={}", options.history),
          "CORE_PEER_TLS_ENABLED=true",
          "CORE_PEER_TLS_KEY_FILE=" + tls_file(own, "server.key"),
          "CORE_PEER_TLS_CERT_FILE=" + tls_file(own, "server.crt"),
          "CORE_PEER_TLS_ROOTCERT_FILE=" + tls_file(own, "ca.crt"),
          "CORE_PEER_GOSSIP_BOOTSTRAP=" + listen,
          "CORE_PEER_GOSSIP_ENDPOINT=" + listen,
          "CORE_PEER_GOSSIP_EXTERNALENDPOINT=" + listen,
          "CORE_PEER_GOSSIP_USELEADERELECTION=false",
          "CORE_PEER_GOSSIP_ORGLEADER=true",
          "CORE_PEER_GOSSIP_STATE_ENABLED=false",
          "CORE_PEER_GOSSIP_STATE_BLOCKBUFFERSIZE=200",
          "CORE_PEER_GOSSIP_RECONNECTINTERVAL=1s",
          "CORE_PEER_GOSSIP_ALIVETIMEINTERVAL=1s",
          "CORE_PEER_DELIVERYCLIENT_BLOCKGOSSIPENABLED=false",
          "CORE_PEER_DELIVERYCLIENT_RECONNECTBACKOFFTHRESHOLD=1s",
          "CORE_VM_ENDPOINT=",
          "CORE_CHAINCODE_EXTERNALBUILDERS=[{name: ccaas, path: " + yaml_text(options.dir + "/builder") +
              ", propagateEnvironment: [CORE_PEER_TLS_KEY_FILE, CORE_PEER_TLS_CERT_FILE]}]",
          "CORE_OPERATIONS_LISTENADDRESS=127.0.0.1:0",
          "CORE_METRICS_PROVIDER=disabled"};
}

std::vector<std::string> admin_environment(const Options& options, const ListenAddresses& addresses, int organisation) {
  return {"FABRIC_CFG_PATH=" + options.tools + "/config",
          "FABRIC_LOGGING_SPEC=warn",
          "CORE_PEER_ADDRESS=" + addresses.peer(organisation),
          "CORE_PEER_LOCALMSPID=" + msp_id_of(organisation),
          "CORE_PEER_MSPCONFIGPATH=" + (identities::user_dir(options.dir, organisation, "Admin") / "msp").string(),
          "CORE_PEER_TLS_ENABLED=true",
          "CORE_PEER_TLS_ROOTCERT_FILE=" + tls_file(identities::peer_dir(options.dir, organisation), "ca.crt")};
}

std::vector<std::string> chaincode_environment(const Options& options, const ListenAddresses& addresses,
                                               int organisation, const std::string& package_id) {
  const auto own = identities::organisation_dir(options.dir, organisation) / "chaincode";
  return {"CHAINCODE_ID=" + package_id, "CHAINCODE_SERVER_ADDRESS=" + addresses.chaincode(organisation),
          "CHAINCODE_TLS_KEY=" + tls_file(own, "server.key"), "CHAINCODE_TLS_CERT=" + tls_file(own, "server.crt"),
          "CHAINCODE_TLS_CLIENT_CA=" + tls_file(identities::peer_dir(options.dir, organisation), "ca.crt")};
}

std::string connection_json(const ListenAddresses& addresses, int organisation, const std::string& ca_pem) {
  return chaincode_lifecycle::connection_json(
      {.address = addresses.chaincode(organisation), .root_pem = ca_pem, .client_auth = true});
}

std::string builder_script(const std::string& name) {
  // Arguments: detect SOURCE METADATA; build SOURCE METADATA OUTPUT; release OUTPUT RELEASE.
  if (name == "detect") return "#!/bin/sh\ngrep -q '\"type\": *\"ccaas\"' \"$2/metadata.json\"\n";
  if (name == "build") return "#!/bin/sh\ncp \"$1/connection.json\" \"$3/\"\n";
  // The peer calls the service with its own TLS pair, put in here from its own folder before the file's closing brace:
  // a package has no key. A package that brings a pair of its own keeps it.
  return R"sh(#!/bin/sh
set -eu
umask 077
pem() { sed 's/$/\\n/' "$1" | tr -d '\n'; }
certificate=$(pem "$CORE_PEER_TLS_CERT_FILE")
key=$(pem "$CORE_PEER_TLS_KEY_FILE")
connection=$(cat "$1/connection.json")
case $connection in
  *'"client_key"'*) ;;
  *) connection="${connection%\}*},\"client_cert\":\"$certificate\",\"client_key\":\"$key\"}" ;;
esac
mkdir -p "$2/chaincode/server"
printf '%s\n' "$connection" > "$2/chaincode/server/connection.json"
)sh";
}

}  // namespace ledgerline::network
