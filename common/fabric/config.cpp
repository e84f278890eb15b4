#include "common/fabric/config.hpp"

#include <fmt/format.h>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/common.pb.h"
#include "common/config/other_tables.hpp"
#include "common/fabric/channels.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::fabric {
namespace {

const Error incomplete{"keys of [ledger] or [[msp]] are missing or wrong"};

crypto::Library library_of(Config& config, const Key& key, const std::string& otherwise) {
  const std::string name = config.choice(key, {"mbedtls", "libcrypto"}, otherwise);
  return name == "mbedtls" ? crypto::Library::mbedtls : crypto::Library::libcrypto;
}

Key verifier_key() { return {"ledger.verifier", "library that checks signatures"}; }

BlockSource block_source(Config& config) {
  const std::string name =
      config.choice({"ledger.blocks",
                     "`peer`: our own peer's; `ordered`: an orderer's where they come first, validated here and "
                     "confirmed by the peer later (needs config_block; transfers each block twice)"},
                    {"peer", "ordered"}, "peer");
  return name == "ordered" ? BlockSource::ordered : BlockSource::peer;
}

std::string server_name(Config& config, const std::string& table) {
  return config.text({table + "server_name", "name in that certificate", "the endpoint's host"}, "");
}

/// That of [ledger] where this table has none.
ClientConfig::TlsPair tls_pair(Config& config, const std::string& table) {
  constexpr const char *as_ledger = "as that of [ledger]", *otherwise = "that of [ledger]";
  return {config.text({table + "tls_certificate", as_ledger, otherwise}, ""),
          config.text({table + "tls_key", as_ledger, otherwise}, "")};
}

std::vector<ClientConfig::Server> servers(Config& config, const Key& table) {
  std::vector<ClientConfig::Server> out;
  const std::size_t count = config.table_count(table);
  for (std::size_t i = 0; i < count; ++i) {
    const std::string key = fmt::format("{}.{}.", table.name, i);
    out.push_back({config.text({key + "endpoint", "HOST:PORT"}),
                   config.text({key + "tls_ca", "PEM file of its authorities, as that of [ledger]"}),
                   server_name(config, key), tls_pair(config, key)});
  }
  return out;
}

/// Whether it can be one is not looked at.
crypto::IdentitySource identity_source(Config& config) {
  crypto::IdentitySource source;
  source.msp_id = config.text({"ledger.msp_id", "our organisation, such as Org1MSP"});
  source.msp_dir = config.text({"ledger.msp_dir",
                                "folder with signcerts/ and keystore/ (*_sk, priv-key.pem or the only file); or "
                                "`certificate` and `private_key`"},
                               "");
  source.files = {config.text({"ledger.certificate", "PEM file, in place of msp_dir"}, ""),
                  config.text({"ledger.private_key",
                               "PEM file of its key, P-256 or P-384: readable by its owner alone, or root's and "
                               "readable by a group of ours, as Kubernetes mounts secrets (fsGroup)"},
                              "")};
  source.library = library_of(config, {"ledger.signer", "libcrypto needs a tenth of mbedTLS's time"}, "libcrypto");
  return source;
}

}  // namespace

Result<ClientConfig> ledger_config(Config& config, std::chrono::milliseconds deadline) {
  ClientConfig out;
  out.endpoint = config.text({"ledger.endpoint", "HOST:PORT of our organisation's peer, or of the embedded node"});
  out.tls_ca_file = config.text(
      {"ledger.tls_ca", "PEM file of the authorities, root or intermediate, that signed its TLS certificate"});
  out.server_name = server_name(config, "ledger.");
  out.tls_pair = {config.text({"ledger.tls_certificate",
                               "PEM file of our TLS certificate with its intermediates, for a server that wants one "
                               "(clientAuthRequired, --tls-client-ca)"},
                              ""),
                  config.text({"ledger.tls_key", "its key; as private_key"}, "")};
  out.where.channel = config.text({"ledger.channel", "of Fabric"}, out.where.channel);
  out.where.contract = config.text({"ledger.contract", "the chaincode's name on it"}, out.where.contract);
  out.max_in_flight = static_cast<std::size_t>(
      config.integer({"ledger.max_in_flight", "calls in flight; more are refused at once"}, 64, 1, 10'000));
  out.deadline = std::chrono::milliseconds(
      config.integer({"ledger.deadline_ms", "of a call; agent and ground take 1,000, the others 5,000", "see there"},
                     deadline.count(), 100, 600'000));
  out.timeouts_of_channel =
      config.choice({"ledger.timeouts",
                     "of agent and ground: `auto` lengthens deadline_ms, agent's check.max_age_ms and "
                     "agent.ledger_silent_after_ms by twice the channel's BatchTimeout (of config_block, else the "
                     "peer's word; nothing where each transaction is a block) and logs it"},
                    {"fixed", "auto"}, "fixed") == "auto";
  out.orderers =
      servers(config, {"orderer", "for the direct path, which saves the gateway's two steps; none: the gateway alone"});
  const Key endorsers{"endorser",
                      "peer that endorses for its organisation, on the direct path: leases need two organisations, "
                      "commands the drones' owner; none: the gateway finds them"};
  const std::size_t count = config.table_count(endorsers);
  for (std::size_t i = 0; i < count; ++i) {
    const std::string key = fmt::format("endorser.{}.", i);
    out.endorsers.push_back({config.text({key + "msp_id", "such as Org2MSP"}),
                             config.text({key + "endpoint", "HOST:PORT"}),
                             config.text({key + "tls_ca", "PEM file of its authorities, as that of [ledger]"}),
                             server_name(config, key), tls_pair(config, key)});
  }
  out.other_peers = servers(config, {"peer", "stand in for everything while that of [ledger] is not reached"});
  const std::string config_block =
      config.text({"ledger.config_block",
                   "file with a config block of the channel, the trust anchor (CHANNEL.block in the folder of "
                   "`ledgerline fabric` and ledgerline-node): blocks must be signed by its orderers, or those of a "
                   "later configuration; none: the peer's blocks are taken unverified"},
                  "");
  out.blocks = block_source(config);
  out.identity_source = identity_source(config);
  out.verifier = library_of(config, verifier_key(), "libcrypto");
  if (out.endpoint.empty() || out.tls_ca_file.empty() || out.identity_source.msp_id.empty()) return incomplete;
  const crypto::IdentityFiles& files = out.identity_source.files;
  const bool any_file = !files.certificate.empty() || !files.private_key.empty();
  if (out.identity_source.msp_dir.empty() != any_file || files.certificate.empty() != files.private_key.empty())
    return Error{"[ledger] needs msp_dir, or certificate and private_key: one or the other"};
  const auto source = out.identity_source.files_now();
  if (!source) return source.error();
  auto identity = crypto::load_identity(out.identity_source.library, out.identity_source.msp_id, *source);
  if (!identity) return identity.error();
  out.identity = std::move(*identity);
  if (config_block.empty()) return out;
  auto block = read_file(config_block);
  if (!block) return Error{fmt::format("ledger.config_block: {}", block.error().message)};
  out.config_block = std::move(*block);
  return out;
}

Result<ClientConfig> load_ledger_config(const std::string& file) {
  auto config = Config::load(file);
  if (!config) return config.error();
  auto ledger = ledger_config(*config);
  skip_other_tables(*config);
  (void)read_channels(*config);
  for (const char* table : {"msp", "topic", "enrolled", "bridge", "own_endorser", "serve", "start"})
    config->skip_table(table);
  if (auto status = config->finish(); !status) return status.error();
  return ledger;
}

namespace {

/// All keys are asked for before a file is read: what is not asked for would be reported as unknown.
Result<std::vector<crypto::MspRoot>> read_msps(Config& config) {
  std::vector<std::pair<std::string, std::string>> named;
  bool complete = true;
  const std::size_t count = config.table_count({"msp", "an organisation whose signatures are trusted; at least one"});
  for (std::size_t i = 0; i < count; ++i) {
    const std::string id = config.text({fmt::format("msp.{}.id", i), "its name, such as Org1MSP"});
    const std::string ca = config.text({fmt::format("msp.{}.ca", i), "PEM file of its authority, with intermediates"});
    named.emplace_back(id, ca);
    complete = complete && !named.back().first.empty() && !named.back().second.empty();
  }
  if (!complete) return incomplete;
  std::vector<crypto::MspRoot> roots;
  for (const auto& [id, path] : named) {
    auto pem = crypto::read_certificate_file(path);
    if (!pem) return Error{fmt::format("[[msp]] {}: {}", id, pem.error().message)};
    roots.push_back({id, std::move(*pem)});
  }
  return roots;
}

std::string authorities_of(const std::string& msp_id, const std::vector<crypto::MspRoot>& msps) {
  std::string all;
  for (const crypto::MspRoot& root : msps)
    if (root.msp_id == msp_id) all += root.ca_pem + "\n";
  return all;
}

}  // namespace

Result<std::unique_ptr<crypto::MspRegistry>> msp_registry(Config& config) {
  const crypto::Library verifier = library_of(config, verifier_key(), "libcrypto");
  auto roots = read_msps(config);
  if (!roots) return roots.error();
  if (roots->empty()) return Error{"the config names no organisation to trust; add [[msp]] with id and ca"};
  return crypto::make_msp_registry(verifier, std::move(*roots));
}

Result<std::vector<crypto::MspRoot>> load_msps(const std::string& file) {
  auto config = Config::load(file);
  return config ? read_msps(*config) : config.error();
}

namespace {

Result<ChannelConfig> channel_of(const ClientConfig& config) {
  if (!config.config_block.empty()) {
    common::Block block;
    if (!block.ParseFromString(config.config_block)) return Error{"ledger.config_block: it is no block"};
    return read_channel_config(block);
  }
  const auto questions = PeerQueries::create(config);
  return questions ? (*questions)->channel_config() : questions.error();
}

}  // namespace

Status check_certificate_of(const std::string& msp_id, const std::string& certificate_pem, const ClientConfig& config,
                            const std::vector<crypto::MspRoot>& msps) {
  crypto::MspRoot known{msp_id, authorities_of(msp_id, msps)};
  if (msp_id == config.identity_source.msp_id && !config.identity_source.msp_dir.empty()) {
    const auto own = crypto::authorities_in(config.identity_source.msp_dir);
    if (!own) return own.error();
    known.ca_pem += *own;
  }
  if (!config.config_block.empty()) {
    const auto channel = channel_of(config);
    if (!channel) return channel.error();
    known.ca_pem += authorities_of(msp_id, channel->organisations);
    for (const crypto::MspRoot& root : channel->organisations)
      if (root.msp_id == msp_id) known.revocation_lists_pem += root.revocation_lists_pem;
  }
  if (known.ca_pem.empty()) return done;
  const auto certificate = crypto::parse_certificate(certificate_pem);
  if (!certificate) return certificate.error();
  const Status member = crypto::check_member(std::move(known), certificate_pem);
  if (member) return done;
  return Error{fmt::format("is no certificate of {}: it was issued by {} ({})", msp_id, certificate->issuer,
                           member.error().message)};
}

Result<TimeNs> apply_timeouts(ClientConfig& config) {
  if (!config.timeouts_of_channel) return TimeNs{0};
  const auto wrong = [&](const std::string& why) { return of_channel(config, Error{"ledger.timeouts: " + why}); };
  const auto channel = channel_of(config);
  if (!channel) return wrong("the channel's settings are not known: " + channel.error().message);
  if (!channel->batching) return wrong("the channel's configuration has no BatchTimeout");
  const TimeNs both_ns = both_ways_ns(channel->batching->timeout_ns, channel->batching->max_messages);
  spdlog::info(
      "blocks are cut {:g} s behind their first transaction, or at {}: a command may come {:g} s later than it "
      "would if each were cut at once, and limits are so much longer",
      to_seconds(channel->batching->timeout_ns), channel->batching->max_messages, to_seconds(both_ns));
  config.deadline += std::chrono::milliseconds(both_ns / ns_per_ms);
  return both_ns;
}

}  // namespace ledgerline::fabric
