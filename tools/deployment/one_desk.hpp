#pragma once
#include "tools/deployment/deployment.hpp"

namespace ledgerline::deployment {

/// What a deployment says of a flight of simulated drones on this machine.
struct OneDesk {
  int drones = 0;
  LedgerKind ledger = LedgerKind::embedded;
  int orderers = 1;
};

/// An error where such a flight would have to pass over something that the file says (docs/deployment.md).
Result<OneDesk> on_one_desk(const Deployment& deployment);

}  // namespace ledgerline::deployment
