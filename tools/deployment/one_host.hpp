#pragma once
#include "tools/deployment/deployment.hpp"

namespace ledgerline::deployment {

/// What a deployment says of a flight of simulated drones on this machine.
struct OneHost {
  int drones = 0;
  LedgerKind ledger = LedgerKind::embedded;
  int orderers = 1;
};

/// `config`: the file that the deployment was read from. Each thing that such a flight would have to pass over
/// (docs/deployment.md) is an error with its file, line and key; all of them come at once.
Result<OneHost> on_one_host(Config& config, const Deployment& deployment);
Result<OneHost> read_one_host(Config& config);

}  // namespace ledgerline::deployment
