#include "chaincode/network/setup/site.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <nlohmann/json.hpp>

#include "chaincode/identities/identities.hpp"
#include "chaincode/network/files/authority.hpp"
#include "chaincode/network/options.hpp"
#include "common/base/file.hpp"
#include "common/base/log.hpp"

namespace ledgerline::network {

namespace fs = std::filesystem;

Site::Site(Options options)
    : options_(std::move(options)), watch_(options_.channels, [this](int orderer) { return signs_of(orderer); }) {}

Status Site::open() {
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
  auto addresses = choose_listen_addresses(options_);
  if (!addresses) return addresses.error();
  addresses_ = std::move(*addresses);
  return done;
}

std::vector<int> Site::own_organisations() const {
  std::vector<int> own;
  for (int k = 1; k <= identities::organisations; ++k) {
    if (options_.runs_organisation(k)) own.push_back(k);
  }
  return own;
}

std::vector<int> Site::own_orderers() const {
  std::vector<int> own;
  for (int k = 1; k <= options_.orderers; ++k) {
    if (options_.runs_orderer(k)) own.push_back(k);
  }
  return own;
}

Status Site::once(const std::string& name, const std::function<Status()>& step) {
  const std::string mark = in("done/" + name);
  if (fs::exists(mark)) return done;
  if (Status s = step(); !s) return s;
  return write_file(mark, "", 0644);
}

Status Site::once_per_channel(const std::string& name, const std::function<Status(const std::string&)>& step) {
  for (const std::string& channel : options_.channels) {
    if (Status s = once(name + "-" + channel, [&] { return step(channel); }); !s) return s;
  }
  return done;
}

Status Site::poll(TimeNs duration) {
  if (Status s = processes_->poll(duration); !s) return s;
  for (const std::string& name : watch_.update(monotonic_ns(), processes_->states())) {
    spdlog::warn("{} has not taken part in Raft for {:.0f} s since its start: it hangs, and is ended", name,
                 to_seconds(OrdererWatch::limit_ns));
    processes_->kill(name);
  }
  return done;
}

std::map<std::string, RaftSign> Site::signs_of(int orderer) const {
  const auto metrics = fetch_metrics(addresses_.orderer_operations(orderer));
  return metrics ? raft_signs(*metrics) : std::map<std::string, RaftSign>{};
}

Status Site::run_until_good(const std::string& what, const std::vector<std::string>& command,
                            const std::vector<std::string>& environment, const std::string& good_too) {
  return processes_->run_until_good(what, command, environment, timeout(), good_too);
}

Status Site::call_peer(const std::string& what, int organisation, std::vector<std::string> words,
                       const std::string& good_too) {
  words.insert(words.begin(), tool("peer"));
  return run_until_good(what, words, admin_environment(options_, addresses_, organisation), good_too);
}

Result<std::unique_ptr<fabric::Client>> Site::connect(int organisation, const std::string& channel) const {
  fabric::ClientConfig config;
  config.endpoint = addresses_.peer(organisation);
  config.tls_ca_file = identities::peer_dir(options_.dir, organisation) / "tls" / "ca.crt";
  config.where.channel = channel;
  auto identity = crypto::load_identity(crypto::Library::libcrypto, identities::msp_id_of(organisation),
                                        identities::user_dir(options_.dir, organisation, "Admin") / "msp");
  if (!identity) return identity.error();
  config.identity = std::move(*identity);
  return fabric::Client::create(std::move(config));
}

namespace {

Status issue_identities(Site& site, const identities::Hosts& hosts) {
  if (!site.options().ca) return identities::make(site.options().dir, site.options().orderers, hosts);
  const Authorities all = authorities(site.options(), site.addresses());
  if (Status s = prepare_authorities(all); !s) return s;
  if (Status s = check_free(site.addresses().authorities); !s) return s;
  for (int k = 0; k <= identities::organisations; ++k) {
    if (Status s = site.processes().start(authority_name(k), site.addresses().authority(k), authority_command(all),
                                          authority_environment(all, k));
        !s) {
      return s;
    }
  }
  const TimeNs until = monotonic_ns() + starting_limit_ns;
  for (int k = 0; k <= identities::organisations; ++k) {
    while (!authority_listens(all, k)) {
      if (Status s = site.processes().poll(10 * ns_per_ms); !s) return s;
      if (monotonic_ns() > until) return Error{authority_name(k) + " does not listen"};
    }
  }
  return identities::make(site.options().dir, site.options().orderers, hosts,
                          [&](const auto& wanted) { return issue_by_authorities(all, wanted); });
}

}  // namespace

Status make_crypto_material(Site& site) {
  if (site.options().several_hosts() && !std::filesystem::exists(site.in("crypto"))) {
    return Error{site.in("crypto") +
                 " is missing: the hosts of a network share its identities. Make them on one host with `ledgerline "
                 "fabric identities`, and bring each its own folder"};
  }
  identities::Hosts hosts;
  for (const ListenAddress& address : site.options().organisation_addresses)
    hosts.organisations.push_back(address.host);
  for (const ListenAddress& address : site.options().orderer_addresses) hosts.orderers.push_back(address.host);
  if (Status s = issue_identities(site, hosts); !s) return s;
  for (const char* name : {"detect", "build", "release"}) {
    if (Status s = write_file(site.in(std::string("builder/bin/") + name), builder_script(name), 0755); !s) return s;
  }
  return done;
}

namespace {

constexpr TimeNs leader_limit_ns = 40 * ns_per_s;  // one that hangs at its start is found and started again meanwhile

std::string first_block_of(const Site& site, const std::string& channel) { return site.in(channel + ".block"); }

Status make_first_block(Site& site, const std::string& channel) {
  const auto made =
      site.processes().run("making the first block of channel " + channel,
                           {site.tool("configtxgen"), "-configPath", site.in("config"), "-profile", "Ledgerline",
                            "-channelID", channel, "-outputBlock", first_block_of(site, channel)},
                           {});
  if (!made) return made.error();
  return done;
}

Status join_orderers_to(Site& site, const std::string& channel) {
  for (const int k : site.own_orderers()) {
    // In the name of the orderer itself, on its own host: no host needs the key of the orderers' administrator.
    const auto own = identities::orderer_dir(site.options().dir, k) / "tls";
    if (Status s = site.run_until_good(
            fmt::format("orderer {} joining channel {}", k, channel),
            {site.tool("osnadmin"), "channel", "join", "--channelID", channel, "--config-block",
             first_block_of(site, channel), "-o", site.addresses().orderer_admin(k), "--ca-file", own / "ca.crt",
             "--client-cert", own / "server.crt", "--client-key", own / "server.key"},
            {}, "channel already exists");
        !s) {
      return s;
    }
  }
  return done;
}

Status join_peers_to(Site& site, const std::string& channel) {
  for (const int k : site.own_organisations()) {
    if (Status s = site.call_peer(fmt::format("peer {} joining channel {}", k, channel), k,
                                  {"channel", "join", "-b", first_block_of(site, channel)}, "already exists");
        !s) {
      return s;
    }
  }
  return done;
}

Result<Counts> count_on(Site& site, const std::string& channel) {
  const int organisation = site.own_organisations().front();
  const auto printed = site.processes().run(fmt::format("asking peer {} for its height", organisation),
                                            {site.tool("peer"), "channel", "getinfo", "-c", channel},
                                            admin_environment(site.options(), site.addresses(), organisation));
  if (!printed) return printed.error();
  const auto brace = printed->find('{');
  const auto info = nlohmann::json::parse(printed->substr(std::min(brace, printed->size())), nullptr, false);
  Counts counts;
  counts.blocks = info.is_object() ? info.value("height", std::uint64_t{0}) : 0;
  if (counts.blocks == 0) return Error{"a peer does not say its height: " + *printed};
  const auto client = site.connect(organisation, channel);
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

}  // namespace

Status make_first_blocks(Site& site) {
  if (Status s = write_file(site.in("config/configtx.yaml"), configtx_yaml(site.options(), site.addresses()), 0644);
      !s) {
    return s;
  }
  return site.once_per_channel("block", [&](const std::string& channel) { return make_first_block(site, channel); });
}
Status join_orderers(Site& site) {
  return site.once_per_channel("ordering", [&](const std::string& channel) { return join_orderers_to(site, channel); });
}
Status join_peers(Site& site) {
  return site.once_per_channel("peers", [&](const std::string& channel) { return join_peers_to(site, channel); });
}

Status wait_for_leader(Site& site) {
  const std::vector<int> own = site.own_orderers();
  if (own.size() < static_cast<std::size_t>(site.options().orderers)) return done;
  const TimeNs until = monotonic_ns() + leader_limit_ns;
  for (const std::string& channel : site.options().channels) {
    while (std::none_of(own.begin(), own.end(), [&](int k) { return site.signs_of(k)[channel].leads; })) {
      if (Status s = site.poll(20 * ns_per_ms); !s) return s;
      if (monotonic_ns() > until) {
        return Error{fmt::format("no orderer leads channel {} after {:.0f} s", channel, to_seconds(leader_limit_ns))};
      }
    }
  }
  return done;
}

Result<Counts> count_blocks(Site& site) {
  Counts all;
  if (site.own_organisations().empty()) return all;
  for (const std::string& channel : site.options().channels) {
    const auto one = count_on(site, channel);
    if (!one) return one.error();
    all.blocks += one->blocks;
    all.transactions += one->transactions;
  }
  return all;
}

}  // namespace ledgerline::network
