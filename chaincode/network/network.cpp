#include "chaincode/network/network.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <condition_variable>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "chaincode/identities/first_enrolments.hpp"
#include "chaincode/identities/identities.hpp"
#include "chaincode/network/files/authority.hpp"
#include "chaincode/network/files/texts.hpp"
#include "common/base/disk_space.hpp"
#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/fabric/client/client.hpp"
#include "common/msg/contract.hpp"

namespace ledgerline::fabric_network {
namespace {

namespace fs = std::filesystem;

constexpr TimeNs starting_limit_ns = 20 * ns_per_s;
constexpr TimeNs leader_limit_ns = 40 * ns_per_s;  // one that hangs at its start is found and started again meanwhile
constexpr const char* label = "ledgerline_1";

/// Empty: it is free. Otherwise why it cannot be listened on.
std::string in_the_way_at(const ListenAddress& at) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  const sockaddr_in place = at.address();
  const bool free = ::bind(fd, reinterpret_cast<const sockaddr*>(&place), sizeof place) == 0;
  const int why = errno;
  ::close(fd);
  if (free) return {};
  return why == EADDRINUSE ? "is taken: does this network run already, or another program?" : std::strerror(why);
}

Status check_free(const std::vector<ListenAddress>& places) {
  for (const ListenAddress& place : places) {
    if (const std::string why = in_the_way_at(place); !why.empty()) {
      return Error{fmt::format("TCP {} {}", place.text(), why)};
    }
  }
  return done;
}

nlohmann::json to_json(const ListenAddresses& places) {
  nlohmann::json json;
  for (const auto& [name, all] : {std::pair{"orderers", &places.orderers},
                                  {"organisations", &places.organisations},
                                  {"authorities", &places.authorities}}) {
    json[name] = nlohmann::json::array();
    for (const ListenAddress& place : *all) json[name].push_back(place.text());
  }
  return json;
}

Result<ListenAddresses> places_in(const nlohmann::json& json) {
  ListenAddresses places;
  for (const auto& [name, all] : {std::pair{"orderers", &places.orderers},
                                  {"organisations", &places.organisations},
                                  {"authorities", &places.authorities}}) {
    if (!json.is_object() || !json.contains(name) || !json[name].is_array()) return Error{"it is damaged"};
    for (const auto& one : json[name]) {
      auto place = parse_place(one.is_string() ? one.get<std::string>() : "");
      if (!place) return place.error();
      all->push_back(std::move(*place));
    }
  }
  if (places.organisations.size() != identities::organisations) return Error{"it is damaged"};
  return places;
}

std::string first_file(const fs::path& dir) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(dir, error)) return entry.path();
  return dir;
}

}  // namespace

Network::Network(Options options) : options_(std::move(options)) {}

bool Network::marked(const std::string& step) const { return fs::exists(in("done/" + step)); }
Status Network::mark(const std::string& step) { return write_file(in("done/" + step), "", 0644); }

std::vector<int> Network::own_organisations() const {
  std::vector<int> own;
  for (int k = 1; k <= identities::organisations; ++k) {
    if (options_.runs_organisation(k)) own.push_back(k);
  }
  return own;
}

std::vector<int> Network::own_orderers() const {
  std::vector<int> own;
  for (int k = 1; k <= options_.orderers; ++k) {
    if (options_.runs_orderer(k)) own.push_back(k);
  }
  return own;
}

Status Network::run_until_good(const std::string& what, const std::vector<std::string>& command,
                               const std::vector<std::string>& environment, const std::string& good_too) {
  const TimeNs limit = options_.several_hosts() ? options_.patience_ns : starting_limit_ns;
  return processes_->run_until_good(what, command, environment, limit, good_too);
}

Status Network::prepare() {
  for (const auto step :
       {&Network::look_at_directory, &Network::choose_places, &Network::make_identities, &Network::make_first_blocks}) {
    if (Status s = (this->*step)(); !s) return s;
  }
  return done;
}

Status Network::up() {
  for (const auto step :
       {&Network::check_room, &Network::prepare, &Network::check_ports, &Network::make_packages,
        &Network::start_processes, &Network::join_orderers, &Network::join_peers, &Network::start_chaincodes,
        &Network::install, &Network::deploy, &Network::wait_for_contract, &Network::enroll_first}) {
    if (Status s = (this->*step)(); !s) return s;
  }
  processes_->supervise();
  return wait_for_leader();
}

/// After a restart peers answer before the orderers have elected their leader. Where other hosts run orderers too, the
/// leader may be theirs, and cannot be seen from here.
Status Network::wait_for_leader() {
  const std::vector<int> own = own_orderers();
  if (own.size() < static_cast<std::size_t>(options_.orderers)) return done;
  const TimeNs until = monotonic_ns() + leader_limit_ns;
  for (const std::string& channel : options_.channels) {
    while (std::none_of(own.begin(), own.end(), [&](int k) { return signs_of(k)[channel].leads; })) {
      if (Status s = tend(20 * ns_per_ms); !s) return s;
      if (monotonic_ns() > until) {
        return Error{fmt::format("no orderer leads channel {} after {:.0f} s", channel, to_seconds(leader_limit_ns))};
      }
    }
  }
  return done;
}

/// Of one of this host's orderers; none: it does not listen yet.
std::map<std::string, RaftSign> Network::signs_of(int orderer) const {
  const auto metrics = fetch_metrics(places_.orderer_operations(orderer));
  return metrics ? raft_signs(*metrics) : std::map<std::string, RaftSign>{};
}

Status Network::tend(TimeNs duration) {
  if (Status s = processes_->tend(duration); !s) return s;
  watch_orderers();
  return done;
}

void Network::watch_orderers() {
  constexpr TimeNs between = ns_per_s, limit = 10 * ns_per_s;
  const TimeNs now = monotonic_ns();
  if (now < next_watch_) return;
  next_watch_ = now + between;
  for (const Processes::State& state : processes_->states()) {
    if (!state.name.starts_with("orderer") || state.pid == 0) continue;
    Watched& watched = watched_[state.name];
    if (watched.pid != state.pid) watched = {state.pid, StartCheck(options_.channels, limit)};
    if (!watched.check) continue;
    const int number = std::stoi(state.name.substr(std::strlen("orderer")));
    const auto verdict = watched.check->update(now, signs_of(number));  // one that ends is seen by itself
    if (verdict == StartCheck::Verdict::not_known) continue;
    watched.check.reset();
    if (verdict == StartCheck::Verdict::takes_part) continue;
    spdlog::warn("{} has not taken part in Raft for {:.0f} s since its start: it hangs, and is ended", state.name,
                 to_seconds(limit));
    processes_->kill(state.name);
  }
}

Status Network::for_each_channel(const std::string& step, Status (Network::*make)(const std::string& channel)) {
  for (const std::string& channel : options_.channels) {
    if (marked(step + "-" + channel)) continue;
    if (Status s = (this->*make)(channel); !s) return s;
    if (Status s = mark(step + "-" + channel); !s) return s;
  }
  return done;
}

Status Network::make_first_blocks() {
  if (Status s = write_file(in("config/configtx.yaml"), configtx_yaml(options_, places_), 0644); !s) return s;
  return for_each_channel("block", &Network::make_first_block);
}
Status Network::join_orderers() { return for_each_channel("ordering", &Network::join_orderers_to); }
Status Network::join_peers() { return for_each_channel("peers", &Network::join_peers_to); }
Status Network::deploy() { return for_each_channel("contract", &Network::deploy_on); }
Status Network::enroll_first() { return for_each_channel("enrolments", &Network::enroll_first_on); }

Status Network::look_at_directory() {
  if (Status s = check(options_); !s) return s;
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
  if (has_authorities(options_.dir)) {
    options_.ca = true;  // a network begun with them goes on with them
  } else if (options_.ca && fs::exists(in("crypto"))) {
    return Error{in("crypto") + " is not from fabric-ca: begin in an empty directory"};
  }
  processes_ = std::make_unique<Processes>(in("logs"));
  return done;
}

/// Each orderer makes two files of 64 MB for each channel beforehand; some more is for what is written later. What the
/// directory has already is not needed again.
Status Network::check_room() {
  constexpr std::uint64_t orderer_channel = 128ULL << 20, more = 64ULL << 20;
  const std::uint64_t all = own_orderers().size() * options_.channels.size() * orderer_channel + more;
  const std::uint64_t there = bytes_below(options_.dir);
  return check_space(options_.dir, std::max(all - std::min(all, there), more), "the network");
}

Status Network::make_identities() {
  if (options_.several_hosts() && !fs::exists(in("crypto"))) {
    return Error{in("crypto") +
                 " is missing: the hosts of a network share its identities. Make them on one host with `ledgerline "
                 "fabric identities`, and bring each its own folder"};
  }
  identities::Hosts hosts;
  for (const ListenAddress& place : options_.organisation_places) hosts.organisations.push_back(place.host);
  for (const ListenAddress& place : options_.orderer_places) hosts.orderers.push_back(place.host);
  if (Status s = issue_identities(hosts); !s) return s;
  for (const char* name : {"detect", "build", "release"}) {
    if (Status s = write_file(in(std::string("builder/bin/") + name), builder_script(name), 0755); !s) return s;
  }
  return done;
}

Status Network::issue_identities(const identities::Hosts& hosts) {
  if (!options_.ca) return identities::make(options_.dir, options_.orderers, hosts);
  const Authorities all = authorities(options_, places_);
  if (Status s = prepare_authorities(all); !s) return s;
  if (Status s = check_free(places_.authorities); !s) return s;
  for (int k = 0; k <= identities::organisations; ++k) {
    if (Status s = processes_->start(authority_name(k), places_.authority(k), authority_command(all),
                                     authority_environment(all, k));
        !s) {
      return s;
    }
  }
  const TimeNs until = monotonic_ns() + starting_limit_ns;
  for (int k = 0; k <= identities::organisations; ++k) {
    while (!authority_listens(all, k)) {
      if (Status s = processes_->tend(10 * ns_per_ms); !s) return s;
      if (monotonic_ns() > until) return Error{authority_name(k) + " does not listen"};
    }
  }
  return identities::make(options_.dir, options_.orderers, hosts,
                          [&](const auto& wanted) { return issue_by_authorities(all, wanted); });
}

/// The places are in the channels' first blocks and in packages: a directory keeps them.
Status Network::choose_places() {
  const bool given = !options_.organisation_places.empty();
  const ListenAddresses wanted{options_.orderer_places, options_.organisation_places, {}};
  if (const auto kept = read_file(in("places.json")); kept) {
    const auto places = places_in(nlohmann::json::parse(*kept, nullptr, false));
    if (!places) return Error{in("places.json") + ": " + places.error().what};
    places_ = *places;
    if (static_cast<int>(places_.orderers.size()) != options_.orderers || (given && places_ != wanted)) {
      return Error{in("places.json") + " is of a network with other places: begin in an empty directory"};
    }
    if (options_.ca == places_.authorities.empty()) {
      return Error{fmt::format("{} is of a network {} fabric-ca: begin in an empty directory", in("places.json"),
                               options_.ca ? "without" : "with")};
    }
    return done;
  }
  if (given) {
    places_ = wanted;
  } else {
    constexpr int lowest = 20'000, highest = 32'000;  // below the kernel's own choices
    const int parts = ListenAddresses::ports_each * (identities::organisations + options_.orderers);
    const auto count = static_cast<std::uint16_t>(parts + (options_.ca ? identities::organisations + 1 : 0));
    auto first = options_.first_port != 0 ? options_.first_port
                                          : static_cast<std::uint16_t>(lowest + (::getpid() * 31) % (highest - lowest));
    places_ = places_from(options_, first);
    for (int tried = 0; options_.first_port == 0 && tried < 200; ++tried) {
      auto all = places_.bound({});
      all.insert(all.end(), places_.authorities.begin(), places_.authorities.end());
      if (check_free(all)) break;
      first = static_cast<std::uint16_t>(first + count);
      places_ = places_from(options_, first);
    }
  }
  return write_file(in("places.json"), to_json(places_).dump(1), 0644);
}

Status Network::check_ports() { return check_free(places_.bound(options_)); }

Status Network::make_first_block(const std::string& channel) {
  const auto made = processes_->run("making the first block of channel " + channel,
                                    {options_.tools + "/configtxgen", "-configPath", in("config"), "-profile",
                                     "Ledgerline", "-channelID", channel, "-outputBlock", first_block_of(channel)},
                                    {});
  if (!made) return made.error();
  return done;
}

Status Network::make_packages() {
  for (const int k : own_organisations()) {
    const std::string folder = in(fmt::format("package{}", k)), package = folder + "/ledgerline.tgz";
    if (!fs::exists(package)) {
      const auto ca = read_file(identities::peer_dir(options_.dir, k) / "tls" / "ca.crt");
      if (!ca) return ca.error();
      if (Status s = write_file(folder + "/connection.json", connection_json(places_, k, *ca), 0600); !s) return s;
      if (Status s =
              write_file(folder + "/metadata.json", nlohmann::json{{"type", "ccaas"}, {"label", label}}.dump(1), 0644);
          !s) {
        return s;
      }
      const auto inner = processes_->run(
          "packing the chaincode", {"/bin/tar", "-czf", folder + "/code.tar.gz", "-C", folder, "connection.json"}, {});
      if (!inner) return inner.error();
      const auto outer =
          processes_->run("packing the chaincode",
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

Status Network::start_processes() {
  for (const int k : own_orderers()) {
    if (Status s = processes_->start(fmt::format("orderer{}", k), places_.orderer(k), {options_.tools + "/orderer"},
                                     orderer_environment(options_, places_, k));
        !s) {
      return s;
    }
  }
  // Peers take a moment to start; meanwhile the orderers are asked to join.
  for (const int k : own_organisations()) {
    if (Status s =
            processes_->start(fmt::format("peer{}", k), places_.peer(k), {options_.tools + "/peer", "node", "start"},
                              peer_environment(options_, places_, k));
        !s) {
      return s;
    }
  }
  return done;
}

Status Network::join_orderers_to(const std::string& channel) {
  for (const int k : own_orderers()) {
    // In the name of the orderer itself, on its own host: no host needs the key of the orderers' administrator.
    const auto own = identities::orderer_dir(options_.dir, k) / "tls";
    if (Status s =
            run_until_good(fmt::format("orderer {} joining channel {}", k, channel),
                           {options_.tools + "/osnadmin", "channel", "join", "--channelID", channel, "--config-block",
                            first_block_of(channel), "-o", places_.orderer_admin(k), "--ca-file", own / "ca.crt",
                            "--client-cert", own / "server.crt", "--client-key", own / "server.key"},
                           {}, "channel already exists");
        !s) {
      return s;
    }
  }
  return done;
}

Status Network::join_peers_to(const std::string& channel) {
  for (const int k : own_organisations()) {
    if (Status s = run_until_good(fmt::format("peer {} joining channel {}", k, channel),
                                  {options_.tools + "/peer", "channel", "join", "-b", first_block_of(channel)},
                                  admin_environment(options_, places_, k), "already exists");
        !s) {
      return s;
    }
  }
  return done;
}

Status Network::start_chaincodes() {
  for (const int k : own_organisations()) {
    if (Status s = processes_->start(fmt::format("chaincode{}", k), places_.chaincode(k), {options_.chaincode},
                                     chaincode_environment(options_, places_, k, package_ids_[k]));
        !s) {
      return s;
    }
  }
  const TimeNs until = monotonic_ns() + starting_limit_ns;
  for (const int k : own_organisations()) {
    while (!processes_->has_printed(fmt::format("chaincode{}", k), "\"ready\":true")) {
      if (Status s = tend(10 * ns_per_ms); !s) return s;
      if (monotonic_ns() > until) return Error{fmt::format("chaincode{} is not ready", k)};
    }
  }
  return done;
}

Status Network::install() {
  if (marked("installed")) return done;
  for (const int k : own_organisations()) {
    if (Status s = run_until_good(fmt::format("installing the contract on peer {}", k),
                                  {options_.tools + "/peer", "lifecycle", "chaincode", "install",
                                   in(fmt::format("package{}/ledgerline.tgz", k))},
                                  admin_environment(options_, places_, k), "already successfully installed");
        !s) {
      return s;
    }
  }
  return mark("installed");
}

Status Network::deploy_on(const std::string& channel) {
  const std::string peer = options_.tools + "/peer";
  const std::vector<std::string> ordering{"-o", places_.orderer(1), "--tls", "--cafile",
                                          identities::orderer_dir(options_.dir, 1) / "tls" / "ca.crt"};
  const std::vector<std::string> definition{
      "--channelID", channel,      "--name", "ledgerline",         "--version",
      "1",           "--sequence", "1",      "--signature-policy", signature_policy(options_)};
  // One after the other: the command waits from the newest block on, and may miss its own beside others. Those are on
  // other hosts, and then it is soon asked again.
  for (const int k : own_organisations()) {
    std::vector<std::string> command{
        peer, "lifecycle", "chaincode", "approveformyorg", "--package-id", package_ids_[k], "--waitForEventTimeout",
        "10s"};
    command.insert(command.end(), ordering.begin(), ordering.end());
    command.insert(command.end(), definition.begin(), definition.end());
    if (Status s = run_until_good(fmt::format("organisation {} approving the contract on channel {}", k, channel),
                                  command, admin_environment(options_, places_, k), "unchanged content");
        !s) {
      return s;
    }
  }
  if (!options_.runs_organisation(1)) return done;
  std::vector<std::string> command{peer, "lifecycle", "chaincode", "commit"};
  command.insert(command.end(), ordering.begin(), ordering.end());
  command.insert(command.end(), definition.begin(), definition.end());
  for (int k = 1; k <= identities::organisations; ++k) {
    command.insert(command.end(), {"--peerAddresses", places_.peer(k), "--tlsRootCertFiles",
                                   identities::peer_dir(options_.dir, k) / "tls" / "ca.crt"});
  }
  return run_until_good("committing the contract on channel " + channel, command,
                        admin_environment(options_, places_, 1), "new definition must be sequence 2");
}

Status Network::wait_for_contract() {
  for (const std::string& channel : options_.channels) {
    for (const int k : own_organisations()) {
      if (Status s = run_until_good(fmt::format("peer {} answering for the contract on channel {}", k, channel),
                                    {options_.tools + "/peer", "chaincode", "query", "-C", channel, "-n", "ledgerline",
                                     "-c", R"({"Args":["get"]})"},
                                    admin_environment(options_, places_, k));
          !s) {
        return s;
      }
    }
  }
  return done;
}

Status Network::enroll_first_on(const std::string& channel) {
  const TimeNs until = monotonic_ns() + (options_.several_hosts() ? options_.patience_ns : starting_limit_ns);
  for (const FirstEnrolment& enrolment : first_enrolments()) {
    const int k = enrolment.organisation;
    if (!options_.runs_organisation(k)) continue;
    const auto pem = read_file(first_file(identities::user_dir(options_.dir, k, "User1") / "msp" / "signcerts"));
    if (!pem) return pem.error();
    const auto user = crypto::parse_certificate(*pem);
    if (!user) return user.error();
    const auto client = connect(k, "Admin", channel);
    if (!client) return client.error();
    for (;;) {
      const auto outcome =
          (*client)->submit_and_wait({contract::enroll, {enrolment.call({identities::msp_id_of(k), user->subject})}});
      if (outcome.kind == fabric::Outcome::Kind::committed) break;
      if (monotonic_ns() > until) return Error{"the first enrolments: " + outcome.message};
      if (Status s = tend(ns_per_s / 2); !s) return s;
    }
  }
  return done;
}

Result<Network::Counts> Network::count() {
  Counts all;
  if (own_organisations().empty()) return all;
  for (const std::string& channel : options_.channels) {
    const auto one = count_on(channel);
    if (!one) return one.error();
    all.blocks += one->blocks;
    all.transactions += one->transactions;
  }
  return all;
}

Result<Network::Counts> Network::count_on(const std::string& channel) {
  const int organisation = own_organisations().front();
  const auto printed = processes_->run(fmt::format("asking peer {} for its height", organisation),
                                       {options_.tools + "/peer", "channel", "getinfo", "-c", channel},
                                       admin_environment(options_, places_, organisation));
  if (!printed) return printed.error();
  const auto brace = printed->find('{');
  const auto info = nlohmann::json::parse(printed->substr(std::min(brace, printed->size())), nullptr, false);
  Counts counts;
  counts.blocks = info.is_object() ? info.value("height", std::uint64_t{0}) : 0;
  if (counts.blocks == 0) return Error{"a peer does not say its height: " + *printed};
  const auto client = connect(organisation, "Admin", channel);
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
  if (!all) return Error{fmt::format("peer {} gave {} of {} blocks within 20 s", organisation, seen, counts.blocks)};
  return counts;
}

Result<std::unique_ptr<fabric::Client>> Network::connect(int organisation, const std::string& user,
                                                         const std::string& channel) const {
  fabric::ClientConfig config;
  config.endpoint = places_.peer(organisation);
  config.tls_ca_file = identities::peer_dir(options_.dir, organisation) / "tls" / "ca.crt";
  config.where.channel = channel;
  auto identity = crypto::load_identity(crypto::Library::libcrypto, identities::msp_id_of(organisation),
                                        identities::user_dir(options_.dir, organisation, user) / "msp");
  if (!identity) return identity.error();
  config.identity = std::move(*identity);
  return fabric::Client::create(std::move(config));
}

}  // namespace ledgerline::fabric_network
