#include <filesystem>
#include <optional>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/common.pb.h"
#include "common/fabric/validation/channel_config.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"
#include "tools/init/core/host.hpp"

namespace {

using namespace ledgerline;

constexpr const char* about = "Writes the configs of a host by its role, with comments, and makes its key on it.";
constexpr const char* notes = R"(
Examples:
  ledgerline init --deployment-example > deployment.toml
  ledgerline init --request raven --organisation Org1 --out /etc/ledgerline      # key, and raven.csr for the authority
  ledgerline init --certificate raven.pem --out /etc/ledgerline
  ledgerline init --collect /var/lib/ledgerline-node/ledger --out public        # at the ledger, for all other hosts
  ledgerline init --role drone-host --deployment deployment.toml --host raven
  ledgerline init --role ground --profile connection.json --msp-id Org2MSP --drone tello1 --drone tello2
  ledgerline init --role drone-host --deployment deployment.toml --host raven --channel yard=tello2,tello3

Never overwrites a file. docs/three-machines.md goes through it from nothing.
Exit codes: 0 written; 1 not, with what is wrong; 2 wrong usage.)";

struct Options {
  std::string role, deployment, profile, host, msp_id, out = "/etc/ledgerline";
  std::vector<std::string> drones, channels, client_authorities;
  init::Directories folders;
  bool direct = false;
  double batch_timeout_ms = 10;
  int batch_count = 1;
  bool is_timeout_given = false, is_count_given = false;  ///< else the config block's count, where there is one
};

Result<init::ProfilePlan> plan_by_deployment(const Options& options) {
  auto config = Config::load(options.deployment);
  if (!config) return config.error();
  const auto deployment = deployment::read(*config);
  if (!deployment) return deployment.error();
  auto plan = init::plan_of(*deployment, options.host, options.folders);
  if (!plan) return plan.error();
  return init::ProfilePlan{std::move(*plan), {}};
}

Result<fabric::ChannelConfig> read_block(const std::string& path) {
  const auto bytes = read_file(path);
  if (!bytes) return bytes.error();
  common::Block block;
  if (!block.ParseFromString(*bytes)) return Error{path + " is no block"};
  auto config = fabric::read_channel_config(block);
  if (!config) return Error{path + ": " + config.error().message};
  return config;
}

Result<init::ProfilePlan> plan_by_profile(const Options& options) {
  auto text = read_file(options.profile);
  if (!text) return text.error();
  std::optional<fabric::ChannelConfig> block;
  if (!options.folders.config_block.empty()) {
    auto read = read_block(options.folders.config_block);
    if (!read) return read.error();
    block = std::move(*read);
  }
  auto planned = init::plan_of_profile(*text, options.msp_id, options.host, options.folders, options.channels,
                                       std::filesystem::absolute(options.profile).parent_path().string(),
                                       block ? &*block : nullptr);
  if (!planned) return planned.error();
  auto drones = init::drones_of(options.drones);
  if (!drones) return drones.error();
  for (const init::HostDrone& drone : *drones)
    if (!drone.address.empty()) planned->plan.drones.push_back(drone);
  planned->plan.all_drones = std::move(*drones);
  if (!options.direct) planned->plan.orderers.clear();
  return planned;
}

Status write_configs(const Options& options) {
  auto planned = options.deployment.empty() ? plan_by_profile(options) : plan_by_deployment(options);
  if (!planned) return planned.error();
  if (auto status = init::add_channels(planned->plan, options.channels); !status) return status;
  fabric::Batching batching{.timeout_ns = static_cast<TimeNs>(options.batch_timeout_ms * ns_per_ms),
                            .max_messages = static_cast<std::uint32_t>(options.batch_count)};
  const fabric::Batching of_block = planned->batching.value_or(batching);
  if (!options.is_timeout_given) batching.timeout_ns = of_block.timeout_ns;
  if (!options.is_count_given) batching.max_messages = of_block.max_messages;
  planned->plan.timeouts = deployment::timeout_with(fabric::both_ways_ns(batching.timeout_ns, batching.max_messages));
  planned->plan.client_authorities = options.client_authorities;
  const auto files = init::files_of(init::role_of(options.role), planned->plan);
  if (!files) return files.error();
  std::vector<init::NewFile> all;
  for (const init::File& file : *files) all.push_back({options.folders.config + "/" + file.name, file.text});
  for (const init::PublicFile& file : planned->files) all.push_back({file.path, file.content});
  if (auto status = init::write_new(all); !status) return status;
  for (const init::NewFile& file : all) print_line(file.path);
  return done;
}

std::string absolute(const std::string& path) {
  return path.empty() ? path : std::filesystem::absolute(path).lexically_normal().string();
}

void role_options(CommandLine& line, Options& options) {
  line.option("--role", options.role, "what the host is for")
      .one_of(std::vector<std::string>(init::roles.begin(), init::roles.end()));
  line.option("--deployment", options.deployment, "deployment.toml: hosts, drones, ledger").existing_file();
  line.option("--profile", options.profile, "connection profile of Fabric (JSON), in place of --deployment")
      .existing_file()
      .utf8_path();
  line.option("--host", options.host, "which [[host]] of the deployment this is");
  line.option("--msp-id", options.msp_id, "with --profile: the own organisation");
  line.option("--drone", options.drones, "with --profile: NAME, or NAME=ADDRESS of one that this host flies")
      .one_at_a_time();
  line.option(
          "--channel", options.channels,
          "NAME=DRONE,DRONE: a further channel of Fabric, and who is on it; its anchor is OUT/NAME.block. NAME: the "
          "first, where a profile has several")
      .one_at_a_time();
  line.flag(
      "--direct", options.direct,
      "with --profile: agent, ground and bridge go the direct path, by [[orderer]] and [[endorser]] of the profile; "
      "where `ledgerline contract status` says `direct path yes`");
  line.option("--out", options.out, "where the configs are written, and the files that they name lie")
      .utf8_path()
      .shows_default();
  line.option("--state-dir", options.folders.state,
              "where programs keep what they remember; without: their services' own, below /var/lib")
      .utf8_path();
  line.option("--msp-dir", options.folders.msp_dir, "of the identity; without: OUT/msp").utf8_path();
  line.option("--tls-ca", options.folders.tls_ca, "of every server of the ledger; without: OUT/tls/MSPID.pem")
      .utf8_path();
  line.option("--tls-certificate", options.folders.tls_certificate,
              "that programs show where the ledger asks for one (mutual TLS); the identity's own will do")
      .utf8_path();
  line.option("--tls-key", options.folders.tls_key, "of --tls-certificate").utf8_path();
  line.option("--tls-client-ca", options.client_authorities,
              "with --role ledger: an authority whose certificates the embedded ledger asks its clients for")
      .one_at_a_time()
      .utf8_path();
  line.option("--config-block", options.folders.config_block,
              "trust anchor; without: OUT/CHANNEL.block. With --profile the channel's name, batches and organisations, "
              "with their authorities, are read from it")
      .utf8_path();
  line.option("--batch-timeout", options.batch_timeout_ms,
              "ms, of the channel, in place of the block's: programs wait accordingly")
      .within(0.0, 60'000.0)
      .shows_default();
  line.option("--batch-count", options.batch_count, "of the channel; 1: its timeout does not count")
      .within(1, 10'000)
      .shows_default();
}

/// Which of the options with --role do not fit together; empty: they do.
std::string fault_of(const Options& options) {
  if (options.folders.tls_certificate.empty() != options.folders.tls_key.empty())
    return "--tls-certificate and --tls-key belong together";
  if (!options.client_authorities.empty() && options.role != "ledger") return "--tls-client-ca goes with --role ledger";
  if (options.deployment.empty() == options.profile.empty()) return "--role needs one of --deployment and --profile";
  if (!options.deployment.empty() ? options.host.empty() : options.msp_id.empty())
    return "--deployment needs --host, --profile needs --msp-id";
  return "";
}

}  // namespace

int ledgerline::command::init(int argc, char** argv) {
  CommandLine line("ledgerline init", about, notes);
  Options options;
  bool example = false;
  std::string request, certificate, collect;
  crypto::Subject subject;
  role_options(line, options);
  line.flag("--deployment-example", example, "prints a deployment.toml to begin with");
  line.option("--request", request, "makes a key and OUT/NAME.csr, for an authority to sign");
  line.option("--organisation", subject.organization, "with --request: O of the subject");
  line.option("--unit", subject.unit, "with --request: OU, which is the role in Fabric").shows_default();
  line.option("--certificate", certificate, "what the authority made of the request: beside the key with it");
  line.option("--collect", collect, "folder of a ledger: copies what other hosts need, and no key").existing_path();
  if (const auto end = line.parse(argc, argv)) return *end;
  options.is_timeout_given = line.is_given("--batch-timeout");
  options.is_count_given = line.is_given("--batch-count");

  const int asked =
      (example ? 1 : 0) + !request.empty() + !certificate.empty() + !collect.empty() + !options.role.empty();
  if (asked != 1) return fail({"one of --role, --request, --certificate, --collect, --deployment-example"}, exit_usage);
  options.folders.config = absolute(options.out);
  for (std::string* path : {&options.folders.state, &options.folders.msp_dir, &options.folders.tls_ca,
                            &options.folders.config_block, &options.folders.tls_certificate, &options.folders.tls_key})
    *path = absolute(*path);
  for (std::string& path : options.client_authorities) path = absolute(path);
  if (example) {
    auto text = init::example_deployment();
    if (!text) return fail(text.error());
    std::fputs(text->c_str(), stdout);
    return 0;
  }
  if (!collect.empty()) return exit_code(init::collect_public(collect, options.folders.config));
  const std::string msp_dir = options.folders.msp();
  if (!request.empty()) {
    subject.common_name = request;
    if (request.find('/') != std::string::npos) return fail({"--request is a name, not a path"}, exit_usage);
    const std::string file = options.folders.config + "/" + request + ".csr";
    if (auto status = init::request_identity(msp_dir, file, subject); !status) return fail(status.error());
    print_line(file);
    return 0;
  }
  if (!certificate.empty()) {
    const auto certified = init::install_certificate(options.folders, certificate);
    if (!certified) return fail(certified.error());
    print_line(printable(*certified));
    return 0;
  }
  if (const std::string fault = fault_of(options); !fault.empty()) return fail({fault}, exit_usage);
  return exit_code(write_configs(options));
}
