#pragma once
#include <vector>

#include "ground/core/flight_types.hpp"
#include "hil/sitl/ledger/simulated_ledger.hpp"

namespace ledgerline::hil {

/// Gives a ground what the ledger has for it, in the order of ground's shell: how calls ended, then blocks.
template <typename Give>
void give_news(const std::vector<SimulatedLedger::Ended>& outcomes, const std::vector<fabric::Block>& blocks,
               const Give& give) {
  for (const auto& ended : outcomes) {
    ground::FlightInputs inputs;
    inputs.outcome = &ended.outcome;
    inputs.outcome_id = ended.id;
    give(inputs);
  }
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    ground::FlightInputs inputs;
    inputs.block = &blocks[i];
    inputs.more = i + 1 < blocks.size();
    give(inputs);
  }
}

}  // namespace ledgerline::hil
