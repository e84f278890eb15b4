#include "chaincode/lifecycle/lifecycle.hpp"

#include <fmt/format.h>
#include <chrono>
#include <filesystem>
#include <random>
#include <thread>

#include "common/base/text.hpp"
#include "common/msg/contract.hpp"
#include "common/rt/retry.hpp"
#include "peer/lifecycle/lifecycle.pb.h"
#include "peer/policy.pb.h"

namespace ledgerline::chaincode_lifecycle {

namespace {

constexpr const char* lifecycle_contract = "_lifecycle";
// A peer builds what it installs.
constexpr std::chrono::milliseconds limit{60'000};
// Of a transaction: a block may be cut seconds later. Orderers without a leader yet take none, and the gateway says so
// too late for the call; so it is asked again. Peers try for 10 s to connect to a chaincode's service
// (connection_json).
constexpr std::chrono::milliseconds transaction_limit{15'000};
constexpr std::chrono::seconds timeout{60};
// With jitter, so that administrators whose transactions met in one block do not meet again.
constexpr TimeNs first_pause_ns = 250 * ns_per_ms, max_pause_ns = 1 * ns_per_s;
// A peer that has just started does not know the others' yet.
constexpr const char* no_peers_yet = "can satisfy the endorsement policy";

template <typename Message>
Result<Message> parsed(const Result<std::string>& answer) {
  if (!answer) return answer.error();
  Message out;
  if (!out.ParseFromString(*answer)) return Error{"the peer's answer is none of _lifecycle"};
  return out;
}

template <typename Arguments>
Arguments arguments_of(const fabric::ChannelAndContract& where, const Definition& definition) {
  Arguments out;
  out.set_name(where.contract);
  out.set_version(definition.version);
  out.set_sequence(definition.sequence);
  return out;
}

bool says(const Error& error, const char* words) { return error.message.find(words) != std::string::npos; }

}  // namespace

Lifecycle::Lifecycle(fabric::ChannelAndContract where, std::string msp_id,
                     std::unique_ptr<fabric::PeerQueries> questions, std::unique_ptr<fabric::PeerQueries> calls,
                     std::unique_ptr<fabric::Client> client)
    : where_(std::move(where)),
      msp_id_(std::move(msp_id)),
      questions_(std::move(questions)),
      calls_(std::move(calls)),
      client_(std::move(client)) {}

Result<Lifecycle> Lifecycle::connect(fabric::ClientConfig config) {
  config.deadline = limit;
  config.orderers.clear();  // the gateway knows whose endorsements these calls need
  config.endorsers.clear();
  config.blocks = fabric::BlockSource::peer;
  const fabric::ChannelAndContract where = config.where;
  const std::string msp_id = config.identity.name.msp_id;
  auto questions = fabric::PeerQueries::create(config);
  if (!questions) return questions.error();
  config.deadline = transaction_limit;
  auto calls = fabric::PeerQueries::create(config);
  if (!calls) return calls.error();
  config.where.contract = lifecycle_contract;
  auto client = fabric::Client::create(std::move(config));
  if (!client) return client.error();
  return Lifecycle(where, msp_id, std::move(*questions), std::move(*calls), std::move(*client));
}

Result<std::string> Lifecycle::query(const std::string& channel, const std::string& function,
                                     const std::string& argument) {
  return questions_->query({channel, lifecycle_contract}, {function, {argument}});
}

Status Lifecycle::submit(const std::string& function, const std::string& argument, const fabric::EndorsementNeed& need,
                         const std::function<Result<bool>()>& is_done) {
  BackOff pauses(first_pause_ns, max_pause_ns);
  Random random(std::random_device{}());
  for (const auto until = std::chrono::steady_clock::now() + timeout;;
       std::this_thread::sleep_for(std::chrono::nanoseconds(pauses.next(random)))) {
    fabric::Call call{function, {argument}};
    call.need = need;
    const fabric::Outcome outcome = client_->submit_and_wait(std::move(call));
    if (outcome.kind == fabric::Outcome::Kind::committed) return done;
    // One that was given up may have been ordered after all, and a second one is then refused.
    if (const auto there = is_done(); there && *there) return done;
    const Error error{outcome.message};
    const bool may_pass = outcome.kind != fabric::Outcome::Kind::refused || says(error, no_peers_yet);
    if (!may_pass || std::chrono::steady_clock::now() > until) return error;
  }
}

Result<std::vector<Installed>> Lifecycle::installed() {
  const auto answer = parsed<lifecycle::QueryInstalledChaincodesResult>(
      query("", "QueryInstalledChaincodes", lifecycle::QueryInstalledChaincodesArgs().SerializeAsString()));
  if (!answer) return answer.error();
  std::vector<Installed> out;
  for (const auto& one : answer->installed_chaincodes())
    out.push_back({printable(one.package_id()), printable(one.label())});
  return out;
}

Status Lifecycle::install(const std::string& package) {
  lifecycle::InstallChaincodeArgs arguments;
  arguments.set_chaincode_install_package(package);
  const auto answer = query("", "InstallChaincode", arguments.SerializeAsString());
  if (!answer && !says(answer.error(), "already successfully installed")) return answer.error();
  return done;
}

Result<std::optional<Committed>> Lifecycle::committed() {
  lifecycle::QueryChaincodeDefinitionArgs arguments;
  arguments.set_name(where_.contract);
  const auto said = query(where_.channel, "QueryChaincodeDefinition", arguments.SerializeAsString());
  if (!said && says(said.error(), "is not defined")) return std::optional<Committed>();
  const auto answer = parsed<lifecycle::QueryChaincodeDefinitionResult>(said);
  if (!answer) return answer.error();
  Committed out{{printable(answer->version()), answer->sequence()}, answer->validation_parameter(), {}};
  for (const auto& [msp_id, approved] : answer->approvals()) out.approvals[printable(msp_id)] = approved;
  return std::optional<Committed>(std::move(out));
}

Result<std::optional<std::string>> Lifecycle::approved(const Definition& definition) {
  lifecycle::QueryApprovedChaincodeDefinitionArgs arguments;
  arguments.set_name(where_.contract);
  arguments.set_sequence(definition.sequence);
  const auto said = query(where_.channel, "QueryApprovedChaincodeDefinition", arguments.SerializeAsString());
  if (!said && says(said.error(), "could not fetch approved chaincode definition")) return std::optional<std::string>();
  const auto answer = parsed<lifecycle::QueryApprovedChaincodeDefinitionResult>(said);
  if (!answer) return answer.error();
  if (answer->version() != definition.version) return std::optional<std::string>();
  return std::optional<std::string>(printable(answer->source().local_package().package_id()));
}

Result<std::map<std::string, bool>> Lifecycle::approvals(const Definition& definition) {
  const auto answer = parsed<lifecycle::CheckCommitReadinessResult>(
      query(where_.channel, "CheckCommitReadiness",
            arguments_of<lifecycle::CheckCommitReadinessArgs>(where_, definition).SerializeAsString()));
  if (!answer) return answer.error();
  std::map<std::string, bool> out;
  for (const auto& [msp_id, approved] : answer->approvals()) out[printable(msp_id)] = approved;
  return out;
}

Status Lifecycle::contract_answers() {
  const auto answer = calls_->query(where_, {contract::get, {"nothing/*"}});
  return answer ? Status(done) : answer.error();
}

Status Lifecycle::approve(const Definition& definition, const std::string& package_id) {
  auto arguments = arguments_of<lifecycle::ApproveChaincodeDefinitionForMyOrgArgs>(where_, definition);
  arguments.mutable_source()->mutable_local_package()->set_package_id(package_id);
  return submit("ApproveChaincodeDefinitionForMyOrg", arguments.SerializeAsString(),
                {fabric::EndorsementNeed::Count::one, msp_id_}, [&]() -> Result<bool> {
                  const auto now = approved(definition);
                  return now ? Result<bool>(*now == package_id) : now.error();
                });
}

Status Lifecycle::commit(const Definition& definition) {
  return submit("CommitChaincodeDefinition",
                arguments_of<lifecycle::CommitChaincodeDefinitionArgs>(where_, definition).SerializeAsString(),
                {fabric::EndorsementNeed::Count::two}, [&]() -> Result<bool> {
                  const auto now = committed();
                  if (!now) return now.error();
                  return *now && (*now)->definition == definition;
                });
}

Fitness fitness_of(const fabric::ChannelConfig& channel, const std::string& application_policy) {
  protos::ApplicationPolicy policy;
  Fitness out;
  fabric::Policy endorsement = channel.endorsement;
  if (!policy.ParseFromString(application_policy)) {
    out.policy = "one that cannot be read";
    endorsement = fabric::unsatisfiable_policy();
  } else if (policy.has_signature_policy()) {
    out.policy = "a signature policy of its own";
    endorsement = {{policy.signature_policy().SerializeAsString()}, 1};
  } else {
    const std::string& reference = policy.channel_config_policy_reference();
    const bool usual =
        reference.empty() || reference == "/Channel/Application/Endorsement" || reference == "Endorsement";
    out.policy = usual ? "the channel's, " + channel.endorsement_words : "the channel's " + printable(reference);
    if (!usual) endorsement = fabric::unsatisfiable_policy();
  }
  const auto& all = channel.organisations;
  const auto suffice = [&](std::size_t i, std::size_t k) {
    return fabric::satisfies(endorsement, {{all[i].msp_id, true}, {all[k].msp_id, true}});
  };
  std::size_t pairs = 0, good = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    for (std::size_t k = i + 1; k < all.size(); ++k, ++pairs) good += suffice(i, k) ? 1 : 0;
  }
  if (all.size() == 1) pairs = 1, good = fabric::satisfies(endorsement, {{all[0].msp_id, true}}) ? 1 : 0;
  out.direct = pairs > 0 && good == pairs;
  out.direct_why = out.direct  ? "peers of any two organisations suffice"
                   : good == 0 ? "two organisations' endorsements do not suffice, and programs gather no more"
                               : fmt::format("only {} of {} pairs of organisations suffice", good, pairs);
  return out;
}

namespace {

std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

/// The `peer` program counts a relative path from FABRIC_CFG_PATH, and ours from the working folder.
std::string quoted_path(const std::string& path) {
  return quoted(path.empty() ? path : std::filesystem::absolute(path).lexically_normal().string());
}

std::string exported(const std::string& name, const std::string& value) {
  return fmt::format("export {}={}\n", name, quoted(value));
}

std::string exported_path(const std::string& name, const std::string& path) {
  return fmt::format("export {}={}\n", name, quoted_path(path));
}

}  // namespace

std::string PeerCommands::environment() const {
  std::string out =
      exported("CORE_PEER_TLS_ENABLED", "true") + exported("CORE_PEER_LOCALMSPID", client.identity.name.msp_id) +
      exported_path("CORE_PEER_MSPCONFIGPATH", msp_dir.empty() ? "MSP_DIR" : msp_dir) +
      exported("CORE_PEER_ADDRESS", client.endpoint) + exported_path("CORE_PEER_TLS_ROOTCERT_FILE", client.tls_ca_file);
  if (!client.server_name.empty()) out += exported("CORE_PEER_TLS_SERVERHOSTOVERRIDE", client.server_name);
  if (!client.tls_pair.key_file.empty()) {
    out += exported("CORE_PEER_TLS_CLIENTAUTHREQUIRED", "true") +
           exported_path("CORE_PEER_TLS_CLIENTCERT_FILE", client.tls_pair.certificate_file) +
           exported_path("CORE_PEER_TLS_CLIENTKEY_FILE", client.tls_pair.key_file);
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
  std::string out = fmt::format("-o {} --tls --cafile {}", quoted(orderer.endpoint), quoted_path(orderer.tls_ca_file));
  if (!orderer.server_name.empty()) out += " --ordererTLSHostnameOverride " + quoted(orderer.server_name);
  const auto& pair = orderer.tls_pair.key_file.empty() ? client.tls_pair : orderer.tls_pair;
  if (!pair.key_file.empty())
    out += fmt::format(" --clientauth --certfile {} --keyfile {}", quoted_path(pair.certificate_file),
                       quoted_path(pair.key_file));
  return out;
}

std::string PeerCommands::of(const Definition& definition) const {
  return fmt::format("--channelID {} --name {} --version {} --sequence {}", quoted(client.where.channel),
                     quoted(client.where.contract), quoted(definition.version), definition.sequence);
}

std::string PeerCommands::approve(const Definition& definition, const std::string& package_id,
                                  const std::string& package_file) const {
  const std::string id =
      package_id.empty() ? fmt::format("\"$(peer lifecycle chaincode calculatepackageid {})\"", quoted(package_file))
                         : quoted(package_id);
  return fmt::format("peer lifecycle chaincode approveformyorg {} {} --package-id {}\n", to_orderer(), of(definition),
                     id);
}

std::string PeerCommands::commit(const Definition& definition) const {
  std::string out = fmt::format("peer lifecycle chaincode commit {} {} --peerAddresses {} --tlsRootCertFiles {}",
                                to_orderer(), of(definition), quoted(client.endpoint), quoted_path(client.tls_ca_file));
  for (const auto& endorser : client.endorsers) {
    if (endorser.endpoint == client.endpoint) continue;
    out += fmt::format(" --peerAddresses {} --tlsRootCertFiles {}", quoted(endorser.endpoint),
                       quoted_path(endorser.tls_ca_file));
  }
  if (client.endorsers.empty()) out += " --peerAddresses OTHER_PEER:7051 --tlsRootCertFiles $PWD/OTHER_PEER_TLS_CA.pem";
  return out + "\n";
}

std::string PeerCommands::status() const {
  return fmt::format(
      "peer lifecycle chaincode queryinstalled\npeer lifecycle chaincode querycommitted --channelID {} --name {}\n",
      quoted(client.where.channel), quoted(client.where.contract));
}

}  // namespace ledgerline::chaincode_lifecycle
