#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "onboard/agent/core/agent_core.hpp"

namespace ledgerline::agent {

/// One status line, a JSON object without the newline. `certificate_days`: until the first of its certificates ends.
std::string status_line(const AgentCore& core, const std::string& channel, TimeNs now,
                        std::optional<std::int64_t> certificate_days = {});

/// True when `now` is at or beyond `next`, which then moves on to a period from now.
bool advance_if_due(TimeNs now, TimeNs& next, TimeNs period_ns);

/// What a channel's core says in the log. Of one kind of message one a second goes out where there may be many.
class AgentLog {
 public:
  /// `label` begins each line. `core` must outlive it.
  AgentLog(const AgentCore& core, std::string label) : core_(core), label_(std::move(label)) {}

  const std::string& label() const { return label_; }
  /// Refused commands, evictions, stops that the ledger does not show, integrity violations.
  void outputs(const AgentOutputs& out);
  void violations(const AgentOutputs& out) const;
  void plan_lost(const Plan& plan) const;
  void outcome(const fabric::Outcome& outcome);
  /// Transitions that were lost since the last call.
  void lost_transitions();

 private:
  void refusals(const AgentOutputs& out);
  void evictions(const AgentOutputs& out) const;

  const AgentCore& core_;
  const std::string label_;
  TimeNs next_refusal_ns_ = 0, next_outcome_ns_ = 0, next_unheard_ns_ = 0;
  std::uint64_t transitions_lost_ = 0;
  bool check_reported_ = false;
};

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
