#include "chaincode/network/network.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "chaincode/network/files/places.hpp"
#include "chaincode/network/files/texts.hpp"
#include "chaincode/network/setup/crypto_material.hpp"
#include "common/base/disk_space.hpp"

namespace ledgerline::fabric_network {
namespace {

using Step = std::function<Status()>;

Status in_order(const std::vector<Step>& steps) {
  for (const Step& step : steps) {
    if (Status s = step(); !s) return s;
  }
  return done;
}

}  // namespace

Status Network::prepare() {
  return in_order({[&] { return site_.open(); }, [&] { return make_crypto_material(site_); },
                   [&] { return make_first_blocks(site_); }});
}

Status Network::up() {
  const Status set_up =
      in_order({[&] { return check_room(); }, [&] { return prepare(); },
                [&] { return check_free(site_.places().bound(site_.options())); },
                [&] { return deployment_.make_packages(); }, [&] { return start_orderers_and_peers(); },
                [&] { return join_orderers(site_); }, [&] { return join_peers(site_); },
                [&] { return deployment_.start_services(); }, [&] { return deployment_.install(); },
                [&] { return deployment_.define(); }, [&] { return deployment_.wait_for_contract(); },
                [&] { return deployment_.wait_for_endorsers(); }, [&] { return deployment_.enroll_first(); }});
  if (!set_up) return set_up;
  site_.processes().supervise();
  return wait_for_leader(site_);
}

/// Each orderer makes two files of 64 MB for each channel beforehand; some more is for what is written later. What the
/// directory has already is not needed again.
Status Network::check_room() {
  constexpr std::uint64_t orderer_channel = 128ULL << 20, more = 64ULL << 20;
  const std::uint64_t all = site_.own_orderers().size() * site_.options().channels.size() * orderer_channel + more;
  const std::uint64_t there = bytes_below(site_.options().dir);
  return check_space(site_.options().dir, std::max(all - std::min(all, there), more), "the network");
}

Status Network::start_orderers_and_peers() {
  for (const int k : site_.own_orderers()) {
    if (Status s = site_.processes().start(
            fmt::format("orderer{}", k), site_.places().orderer(k), {site_.tool("orderer")},
            orderer_environment(site_.options(), site_.places(), k), site_.options().orderer_scheduling());
        !s) {
      return s;
    }
  }
  // Peers take a moment to start; meanwhile the orderers are asked to join.
  for (const int k : site_.own_organisations()) {
    if (Status s = site_.processes().start(
            fmt::format("peer{}", k), site_.places().peer(k), {site_.tool("peer"), "node", "start"},
            peer_environment(site_.options(), site_.places(), k), site_.options().organisation_scheduling(k));
        !s) {
      return s;
    }
  }
  return done;
}

}  // namespace ledgerline::fabric_network
