#include "chaincode/network/setup/channels.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <nlohmann/json.hpp>

#include "chaincode/identities/identities.hpp"
#include "chaincode/network/files/texts.hpp"
#include "common/base/file.hpp"

namespace ledgerline::fabric_network {
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
             first_block_of(site, channel), "-o", site.places().orderer_admin(k), "--ca-file", own / "ca.crt",
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
    if (Status s = site.ask_peer(fmt::format("peer {} joining channel {}", k, channel), k,
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
                                            admin_environment(site.options(), site.places(), organisation));
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
  if (Status s = write_file(site.in("config/configtx.yaml"), configtx_yaml(site.options(), site.places()), 0644); !s) {
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
      if (Status s = site.tend(20 * ns_per_ms); !s) return s;
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

}  // namespace ledgerline::fabric_network
