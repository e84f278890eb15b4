#pragma once
#include <vector>

#include "hil/fault/checker/invariants.hpp"
#include "hil/fault/checker/rule.hpp"

namespace ledgerline::hil {

/// Checks a run moment by moment: the script's rules, then the invariants of every run. Plain data in, verdicts out.
/// One thread.
class Checker {
 public:
  Checker(const std::vector<Rule>& rules, const Limits& limits);

  /// After each step of the world.
  void observe(const Moment& moment);
  /// After the last one.
  std::vector<Verdict> finish(const Ending& ending);

 private:
  void check_rule(const Moment& moment, RuleState& state) const;

  Limits limits_;
  std::vector<RuleState> rules_;
  Invariants invariants_;
  std::vector<bool> flew_;  ///< by drone: was higher than on_ground_m, in flight
};

}  // namespace ledgerline::hil
