#pragma once
#include "chaincode/network/setup/site.hpp"
#include "common/base/result.hpp"

/// The network's channels, each step once: what a directory has done already is not done again.
namespace ledgerline::fabric_network {

/// configtx.yaml and each channel's first block.
Status make_first_blocks(Site& site);
/// This host's orderers and peers, which run, join all channels.
Status join_orderers(Site& site);
Status join_peers(Site& site);
/// Until an orderer leads each channel: after a restart peers answer before the orderers have elected. Where other
/// hosts run orderers too, the leader may be theirs, and cannot be seen from here.
Status wait_for_leader(Site& site);

struct Counts {
  std::uint64_t blocks = 0, transactions = 0;
};
/// What a peer of this host has committed on all channels, the config block and the deployment among it.
Result<Counts> count_blocks(Site& site);

}  // namespace ledgerline::fabric_network
