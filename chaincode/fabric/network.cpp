#include "chaincode/fabric/network.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "chaincode/fabric/texts.hpp"
#include "chaincode/first_enrolments.hpp"
#include "chaincode/identities/identities.hpp"
#include "common/fabric/client.hpp"
#include "common/rt/file.hpp"
#include "common/rt/log.hpp"

namespace ledgerline::fabric_network {
namespace {

namespace fs = std::filesystem;

constexpr TimeNs command_limit_ns = 60 * ns_per_s, starting_limit_ns = 20 * ns_per_s, stop_patience_ns = 5 * ns_per_s;
constexpr int log_lines = 10;
constexpr const char* label = "ledgerline_1";

Status write_file(const fs::path& path, const std::string& text, int mode) {
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  std::ofstream out(path, std::ios::binary);
  ::chmod(path.c_str(), static_cast<mode_t>(mode));
  out << text;
  out.close();
  if (!out) return Error{"cannot write " + path.string()};
  return done;
}

bool is_free(const std::string& host, std::uint16_t port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  sockaddr_in place{};
  place.sin_family = AF_INET;
  place.sin_port = htons(port);
  ::inet_pton(AF_INET, host.c_str(), &place.sin_addr);
  const bool free = ::bind(fd, reinterpret_cast<const sockaddr*>(&place), sizeof place) == 0;
  ::close(fd);
  return free;
}

std::string first_file(const fs::path& dir) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(dir, error)) return entry.path();
  return dir;
}

}  // namespace

Network::Network(Options options)
    : options_(std::move(options)),
      children_({[this](const std::string& name, const std::string& line) { output_[name] += line + "\n"; }}) {}

bool Network::marked(const std::string& step) const { return fs::exists(in("done/" + step)); }
Status Network::mark(const std::string& step) { return write_file(in("done/" + step), "", 0644); }

Status Network::start(const std::string& name, std::vector<std::string> command, std::vector<std::string> environment) {
  services_.push_back(name);
  return children_.start({name, std::move(command), log_of(name), SIGTERM, std::move(environment)});
}

Result<std::string> Network::run(const std::string& what, std::vector<std::string> command,
                                 std::vector<std::string> environment) {
  const std::string name = fmt::format("command{}", ++commands_);
  if (Status s = children_.start({name, std::move(command), log_of(name), SIGTERM, std::move(environment)}); !s) {
    return s.error();
  }
  const TimeNs until = monotonic_ns() + command_limit_ns;
  while (children_.running(name)) {
    if (monotonic_ns() > until) {
      children_.stop(name, ns_per_s);
      return Error{fmt::format("{}: no end after {:.0f} s", what, to_seconds(command_limit_ns))};
    }
    children_.poll(10 * ns_per_ms);
  }
  const std::string printed = output_[name];
  if (!children_.ended_well(name)) {
    return Error{
        fmt::format("{} {}:\n{}{}", what, children_.how_it_ended(name), printed, children_.log_tail(name, log_lines))};
  }
  return printed;
}

Status Network::run_until_good(const std::string& what, const std::vector<std::string>& command,
                               const std::vector<std::string>& environment) {
  const TimeNs until = monotonic_ns() + starting_limit_ns;
  for (TimeNs wait = 20 * ns_per_ms;; wait = std::min(2 * wait, ns_per_s / 2)) {
    const auto printed = run(what, command, environment);
    if (printed) return done;
    if (Status s = tend(wait); !s) return s;
    if (monotonic_ns() > until) return printed.error();
  }
}

Status Network::tend(TimeNs duration) {
  const TimeNs until = monotonic_ns() + duration;
  do {
    children_.poll(std::min<TimeNs>(std::max<TimeNs>(until - monotonic_ns(), 0), 50 * ns_per_ms));
    for (const std::string& name : services_) {
      if (children_.running(name)) continue;
      return Error{fmt::format("{} {}. The end of {}:\n{}", name, children_.how_it_ended(name), log_of(name),
                               children_.log_tail(name, log_lines))};
    }
  } while (monotonic_ns() < until);
  return done;
}

std::map<std::string, double> Network::cpu_seconds() const {
  std::map<std::string, double> all;
  for (const std::string& name : services_) all[name] = children_.cpu_seconds(name);
  return all;
}

Result<Network::Counts> Network::count() {
  const auto printed =
      run("asking peer 1 for its height", {options_.tools + "/peer", "channel", "getinfo", "-c", options_.channel},
          admin_environment(options_, ports_, 1));
  if (!printed) return printed.error();
  const auto brace = printed->find('{');
  const auto info = nlohmann::json::parse(printed->substr(std::min(brace, printed->size())), nullptr, false);
  Counts counts;
  counts.blocks = info.is_object() ? info.value("height", std::uint64_t{0}) : 0;
  if (counts.blocks == 0) return Error{"peer 1 does not say its height: " + *printed};
  const auto client = connect(1, "Admin");
  if (!client) return client.error();
  std::mutex mutex;
  std::condition_variable grown;
  std::uint64_t seen = 0;
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [&](const fabric::Block& block, std::string_view) {
    const std::lock_guard lock(mutex);
    counts.transactions += block.transactions.size();
    seen = block.number + 1;
    grown.notify_one();
  };
  handlers.on_connection = [](bool, const std::string&) {};
  const auto stream = (*client)->blocks(0, std::move(handlers));
  std::unique_lock lock(mutex);
  const bool all = grown.wait_for(lock, std::chrono::seconds(20), [&] { return seen >= counts.blocks; });
  if (!all) return Error{fmt::format("peer 1 gave {} of {} blocks within 20 s", seen, counts.blocks)};
  return counts;
}

Result<std::unique_ptr<fabric::Client>> Network::connect(int organisation, const std::string& user) const {
  fabric::ClientConfig config;
  config.endpoint = address(options_, ports_.peer(organisation));
  config.tls_ca_file = identities::peer_dir(options_.dir, organisation) / "tls" / "ca.crt";
  config.where.channel = options_.channel;
  auto identity = crypto::load_identity(crypto::Library::libcrypto, identities::msp_id_of(organisation),
                                        identities::user_dir(options_.dir, organisation, user) / "msp");
  if (!identity) return identity.error();
  config.identity = std::move(*identity);
  return fabric::Client::create(std::move(config));
}

bool Network::down() {
  bool in_time = true;
  for (auto name = services_.rbegin(); name != services_.rend(); ++name) children_.signal(*name, SIGTERM);
  for (auto name = services_.rbegin(); name != services_.rend(); ++name) {
    in_time = children_.stop(*name, stop_patience_ns) && in_time;
  }
  services_.clear();
  return in_time;
}

Status Network::up() {
  for (const auto step : {&Network::prepare, &Network::choose_ports, &Network::make_genesis, &Network::make_packages,
                          &Network::start_orderers, &Network::start_peers, &Network::start_chaincodes, &Network::deploy,
                          &Network::wait_for_contract, &Network::enroll_first}) {
    if (Status s = (this->*step)(); !s) return s;
  }
  return done;
}

Status Network::prepare() {
  for (const char* program :
       {"orderer", "peer", "configtxgen", "osnadmin", "config/core.yaml", "config/orderer.yaml"}) {
    if (fs::exists(options_.tools + "/" + program)) continue;
    return Error{fmt::format("{}/{} is missing: scripts/fabric-tools builds Fabric's programs (with Go 1.24 or newer)",
                             options_.tools, program)};
  }
  std::error_code error;
  fs::create_directories(in("logs"), error);
  if (error) return Error{"making " + in("logs") + ": " + error.message()};
  options_.dir = fs::canonical(options_.dir, error);
  if (error) return Error{"looking at " + options_.dir + ": " + error.message()};
  if (Status s = identities::make(options_.dir, options_.orderers); !s) return s;
  for (const char* name : {"detect", "build", "release"}) {
    if (Status s = write_file(in(std::string("builder/bin/") + name), builder_script(name), 0755); !s) return s;
  }
  return done;
}

/// The ports are in certificates' channel configuration and in packages: a directory keeps them.
Status Network::choose_ports() {
  if (const auto kept = read_file(in("ports.json")); kept) {
    const auto json = nlohmann::json::parse(*kept, nullptr, false);
    if (!json.is_object() || json.value("orderers", 0) != options_.orderers) {
      return Error{in("ports.json") + " is of a network with other orderers: begin in an empty directory"};
    }
    ports_.first = json.value("first", std::uint16_t{0});
  } else {
    constexpr std::uint16_t lowest = 20'000, highest = 32'000;  // below the kernel's own choices
    ports_.first = options_.first_port != 0
                       ? options_.first_port
                       : static_cast<std::uint16_t>(lowest + (::getpid() * 31) % (highest - lowest));
    for (int tried = 0; options_.first_port == 0 && tried < 200; ++tried, ports_.first += Ports::count) {
      bool all = true;
      for (int i = 0; i < Ports::count; ++i) {
        all = all && is_free(options_.host, static_cast<std::uint16_t>(ports_.first + i));
      }
      if (all) break;
    }
    const nlohmann::json json{{"first", ports_.first}, {"orderers", options_.orderers}};
    if (Status s = write_file(in("ports.json"), json.dump(), 0644); !s) return s;
  }
  for (int i = 0; i < Ports::count; ++i) {
    const auto port = static_cast<std::uint16_t>(ports_.first + i);
    if (!is_free(options_.host, port)) {
      return Error{
          fmt::format("TCP {} is taken: does this network run already, or another program?", address(options_, port))};
    }
  }
  return done;
}

Status Network::make_genesis() {
  if (marked("genesis")) return done;
  if (Status s = write_file(in("config/configtx.yaml"), configtx_yaml(options_, ports_), 0644); !s) return s;
  const auto made = run("making the channel's first block",
                        {options_.tools + "/configtxgen", "-configPath", in("config"), "-profile", "Ledgerline",
                         "-channelID", options_.channel, "-outputBlock", in("genesis.block")},
                        {});
  if (!made) return made.error();
  return mark("genesis");
}

Status Network::make_packages() {
  for (int k = 1; k <= identities::organisations; ++k) {
    const std::string folder = in(fmt::format("package{}", k)), package = folder + "/ledgerline.tgz";
    if (!fs::exists(package)) {
      const auto peer = identities::peer_dir(options_.dir, k) / "tls";
      const auto ca = read_file(peer / "ca.crt"), key = read_file(peer / "server.key"),
                 certificate = read_file(peer / "server.crt");
      if (!ca) return ca.error();
      if (!key) return key.error();
      if (!certificate) return certificate.error();
      if (Status s = write_file(folder + "/connection.json",
                                connection_json(options_, ports_, k, *ca, *key, *certificate), 0600);
          !s) {
        return s;
      }
      if (Status s =
              write_file(folder + "/metadata.json", nlohmann::json{{"type", "ccaas"}, {"label", label}}.dump(1), 0644);
          !s) {
        return s;
      }
      const auto inner = run("packing the chaincode",
                             {"/bin/tar", "-czf", folder + "/code.tar.gz", "-C", folder, "connection.json"}, {});
      if (!inner) return inner.error();
      const auto outer = run("packing the chaincode",
                             {"/bin/tar", "-czf", package + ".new", "-C", folder, "metadata.json", "code.tar.gz"}, {});
      if (!outer) return outer.error();
      fs::rename(package + ".new", package);
    }
    const auto bytes = read_file(package);
    if (!bytes) return bytes.error();
    package_ids_[k] = std::string(label) + ":" + crypto::hex(crypto::sha256(*bytes));
  }
  return done;
}

Status Network::start_orderers() {
  for (int k = 1; k <= options_.orderers; ++k) {
    if (Status s =
            start(fmt::format("orderer{}", k), {options_.tools + "/orderer"}, orderer_environment(options_, ports_, k));
        !s) {
      return s;
    }
  }
  // Peers take a moment to start; meanwhile the orderers are asked to join.
  for (int k = 1; k <= identities::organisations; ++k) {
    if (Status s = start(fmt::format("peer{}", k), {options_.tools + "/peer", "node", "start"},
                         peer_environment(options_, ports_, k));
        !s) {
      return s;
    }
  }
  if (marked("ordering")) return done;
  const auto admin = identities::ordering_dir(options_.dir) / "users" / "Admin@ledgerline" / "tls";
  for (int k = 1; k <= options_.orderers; ++k) {
    if (Status s =
            run_until_good(fmt::format("orderer {} joining the channel", k),
                           {options_.tools + "/osnadmin", "channel", "join", "--channelID", options_.channel,
                            "--config-block", in("genesis.block"), "-o", address(options_, ports_.orderer_admin(k)),
                            "--ca-file", identities::orderer_dir(options_.dir, k) / "tls" / "ca.crt", "--client-cert",
                            admin / "client.crt", "--client-key", admin / "client.key"},
                           {});
        !s) {
      return s;
    }
  }
  return mark("ordering");
}

Status Network::start_peers() {
  if (marked("peers")) return done;
  for (int k = 1; k <= identities::organisations; ++k) {
    if (Status s = run_until_good(fmt::format("peer {} joining the channel", k),
                                  {options_.tools + "/peer", "channel", "join", "-b", in("genesis.block")},
                                  admin_environment(options_, ports_, k));
        !s) {
      return s;
    }
  }
  return mark("peers");
}

Status Network::start_chaincodes() {
  for (int k = 1; k <= identities::organisations; ++k) {
    const std::string name = fmt::format("chaincode{}", k);
    if (Status s = start(name, {options_.chaincode}, chaincode_environment(options_, ports_, k, package_ids_[k])); !s) {
      return s;
    }
  }
  const TimeNs until = monotonic_ns() + starting_limit_ns;
  for (int k = 1; k <= identities::organisations; ++k) {
    while (output_[fmt::format("chaincode{}", k)].find("\"ready\":true") == std::string::npos) {
      if (Status s = tend(10 * ns_per_ms); !s) return s;
      if (monotonic_ns() > until) return Error{fmt::format("chaincode{} is not ready", k)};
    }
  }
  return done;
}

Status Network::deploy() {
  if (marked("contract")) return done;
  const std::string peer = options_.tools + "/peer";
  const std::vector<std::string> ordering{"-o", address(options_, ports_.orderer(1)), "--tls", "--cafile",
                                          identities::orderer_dir(options_.dir, 1) / "tls" / "ca.crt"};
  const std::vector<std::string> definition{
      "--channelID", options_.channel, "--name", "ledgerline",         "--version",
      "1",           "--sequence",     "1",      "--signature-policy", signature_policy(options_)};
  for (int k = 1; k <= identities::organisations; ++k) {
    const auto installed =
        run(fmt::format("installing the contract on peer {}", k),
            {peer, "lifecycle", "chaincode", "install", in(fmt::format("package{}/ledgerline.tgz", k))},
            admin_environment(options_, ports_, k));
    if (!installed && installed.error().what.find("already successfully installed") == std::string::npos) {
      return installed.error();
    }
  }
  // One after the other: the command waits from the newest block on, and would miss its own beside others.
  for (int k = 1; k <= identities::organisations; ++k) {
    std::vector<std::string> command{peer,           "lifecycle",    "chaincode", "approveformyorg",
                                     "--package-id", package_ids_[k]};
    command.insert(command.end(), ordering.begin(), ordering.end());
    command.insert(command.end(), definition.begin(), definition.end());
    const auto approved =
        run(fmt::format("organisation {} approving the contract", k), command, admin_environment(options_, ports_, k));
    if (!approved && approved.error().what.find("unchanged content") == std::string::npos) return approved.error();
  }
  std::vector<std::string> command{peer, "lifecycle", "chaincode", "commit"};
  command.insert(command.end(), ordering.begin(), ordering.end());
  command.insert(command.end(), definition.begin(), definition.end());
  for (int k = 1; k <= identities::organisations; ++k) {
    command.insert(command.end(), {"--peerAddresses", address(options_, ports_.peer(k)), "--tlsRootCertFiles",
                                   identities::peer_dir(options_.dir, k) / "tls" / "ca.crt"});
  }
  const auto committed = run("committing the contract", command, admin_environment(options_, ports_, 1));
  if (!committed && committed.error().what.find("new definition must be sequence 2") == std::string::npos) {
    return committed.error();
  }
  return mark("contract");
}

Status Network::wait_for_contract() {
  for (int k = 1; k <= identities::organisations; ++k) {
    if (Status s = run_until_good(fmt::format("peer {} answering for the contract", k),
                                  {options_.tools + "/peer", "chaincode", "query", "-C", options_.channel, "-n",
                                   "ledgerline", "-c", R"({"Args":["get"]})"},
                                  admin_environment(options_, ports_, k));
        !s) {
      return s;
    }
  }
  return done;
}

Status Network::enroll_first() {
  if (marked("enrolments")) return done;
  for (const FirstEnrolment& enrolment : first_enrolments()) {
    const int k = enrolment.organisation;
    const auto pem = read_file(first_file(identities::user_dir(options_.dir, k, "User1") / "msp" / "signcerts"));
    if (!pem) return pem.error();
    const auto user = crypto::parse_certificate(*pem);
    if (!user) return user.error();
    const auto client = connect(k, "Admin");
    if (!client) return client.error();
    const auto outcome =
        (*client)->submit_and_wait({"enroll", {enrolment.call({identities::msp_id_of(k), user->subject})}});
    if (outcome.kind != fabric::Outcome::Kind::committed) return Error{"the first enrolments: " + outcome.message};
  }
  return mark("enrolments");
}

}  // namespace ledgerline::fabric_network
