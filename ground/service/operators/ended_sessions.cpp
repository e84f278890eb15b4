#include "ground/service/operators/ended_sessions.hpp"

#include <algorithm>

namespace ledgerline::ground::service {

void EndedSessions::add(std::size_t who, TimeNs from_ns) {
  remove(who);
  all_.push_back({who, from_ns, from_ns + limit_ns, from_ns});
}

void EndedSessions::remove(std::size_t who) {
  std::erase_if(all_, [&](const Gone& one) { return one.who == who; });
}

bool EndedSessions::has(std::size_t who) const {
  return std::ranges::any_of(all_, [&](const Gone& one) { return one.who == who; });
}

std::vector<std::size_t> EndedSessions::all() const {
  std::vector<std::size_t> who;
  for (const Gone& one : all_) who.push_back(one.who);
  return who;
}

EndedSessions::Step EndedSessions::step(TimeNs now_ns, std::size_t who, const HeldDrones& held) {
  const auto gone = std::ranges::find_if(all_, [&](const Gone& one) { return one.who == who; });
  Step step;
  if (gone == all_.end() || now_ns < gone->from_ns) return step;
  step.last = now_ns >= gone->until_ns;
  step.give_back = held.aloft.empty() || step.last;
  if (step.give_back || now_ns < gone->next_ns) return step;
  gone->next_ns = now_ns + again_ns;
  step.land = held.aloft;
  return step;
}

}  // namespace ledgerline::ground::service
