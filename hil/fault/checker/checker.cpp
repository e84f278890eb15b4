#include "hil/fault/checker/checker.hpp"

namespace ledgerline::hil {

Checker::Checker(const std::vector<Rule>& rules, const Limits& limits) : limits_(limits), invariants_(limits) {
  for (const Rule& rule : rules) rules_.push_back({.verdict = {rule, true, 0, {}}});
}

void Checker::check_rule(const Moment& moment, RuleState& state) const {
  const RuleKind& kind = *state.verdict.rule.kind;
  state.waits = false;
  state.done.resize(moment.drones.size());
  state.counts.resize(moment.drones.size());
  for (const WorldEvent& event : moment.events) {
    if (kind.hear) kind.hear(state, moment, event);
  }
  for (std::size_t i = 0; i < moment.drones.size(); ++i) {
    if (kind.observe) kind.observe(state, {moment, limits_, flew_}, i);
  }
}

void Checker::observe(const Moment& moment) {
  flew_.resize(moment.drones.size());
  for (RuleState& state : rules_) check_rule(moment, state);
  for (std::size_t i = 0; i < moment.drones.size(); ++i) {
    const sim::Truth& truth = moment.drones[i].truth;
    flew_[i] = flew_[i] || (truth.in_flight && truth.position_m[2] > on_ground_m);
  }
  invariants_.observe(moment);
}

std::vector<Verdict> Checker::finish(const Ending& ending) {
  std::vector<Verdict> verdicts;
  for (RuleState& state : rules_) {
    const RuleKind& kind = *state.verdict.rule.kind;
    if (kind.finish) kind.finish(state, ending);
    verdicts.push_back(state.verdict);
  }
  invariants_.finish(ending);
  verdicts.insert(verdicts.end(), invariants_.verdicts().begin(), invariants_.verdicts().end());
  return verdicts;
}

}  // namespace ledgerline::hil
