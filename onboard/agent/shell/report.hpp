#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "onboard/agent/core/agent_core.hpp"

namespace ledgerline::agent {

/// One status line, a JSON object without the newline. `certificate_days`: until the first of its certificates ends.
std::string status_line(const AgentCore& core, const std::string& channel, TimeNs now,
                        std::optional<std::int64_t> certificate_days = {});

/// What the shell counts itself.
struct ShellCounters {
  std::uint64_t plans_not_handed_over = 0;  ///< no shared memory chunk was left
  std::uint64_t mocap_lost = 0;             ///< the loop was too slow, or it was no pose
  std::uint64_t mocap_implausible = 0;      ///< a stamp or orientation that cannot be
  std::uint64_t records_compared = 0;       ///< times, with another organisation's peer
  std::uint64_t records_differ = 0;         ///< alarms: differences that lasted
  std::uint64_t link_wakes = 0;             ///< turns that link's word of something new began
  std::uint64_t states_without_wake = 0;    ///< found in other turns: some just before the word, all where none comes
  std::uint64_t blocks_not_read = 0;        ///< between the checkpoint and the start, after a long absence
  Quantiles confirmed_after_ms{};           ///< of blocks taken as they were ordered
};
/// The summary file's JSON, of one channel.
std::string summary(const AgentCore& core, const std::string& channel, const ShellCounters& shell);
/// Of several: {"channels": [...]}, each as its own says it.
std::string summary_of_all(const std::vector<std::string>& channels);

}  // namespace ledgerline::agent
