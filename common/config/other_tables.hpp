#pragma once
#include "common/config/config.hpp"

namespace ledgerline {

/// Of agent.toml and ground.toml: skips what is about neither the ledger nor topics, for who reads the rest.
inline void skip_other_tables(Config& config) {
  for (const char* table : {"drone", "dds", "output", "batch", "check", "mocap", "agent", "realtime", "requests",
                            "flight", "service", "mission", "pilot"})
    config.skip_table(table);
}

}  // namespace ledgerline
