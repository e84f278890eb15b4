#include "chaincode/node/core/ordering/fair_lane.hpp"

#include <algorithm>

namespace ledgerline::node {

void FairLane::add(Held held) {
  Organisation& organisation = organisations_[held.sender.msp_id];
  // Who had nothing waiting is not paid for the time in which it sent nothing.
  if (organisation.waiting.empty()) organisation.tag = std::max(organisation.tag, clock_);
  double& tag = organisation.tags[held.sender];
  const Place place{std::max(tag, organisation.clock), held.turn};
  tag = place.tag + static_cast<double>(held.envelope.size());
  organisation.waiting.emplace(place, std::move(held));
  ++count_;
}

FairLane::Organisations::const_iterator FairLane::next() const {
  auto best = organisations_.end();
  for (auto one = organisations_.begin(); one != organisations_.end(); ++one) {
    const Organisation& organisation = one->second;
    if (organisation.waiting.empty()) continue;
    const auto rank = [](const Organisation& of) { return Place{of.tag, of.waiting.begin()->first.turn}; };
    if (best == organisations_.end() || rank(organisation) < rank(best->second)) best = one;
  }
  return best;
}

FairLane::Held FairLane::pop() {
  Organisation& organisation = organisations_.at(next()->first);
  const auto first = organisation.waiting.begin();
  Held held = std::move(first->second);
  clock_ = organisation.tag;
  organisation.clock = first->first.tag;
  organisation.tag += static_cast<double>(held.envelope.size());
  organisation.waiting.erase(first);
  --count_;
  return held;
}

void FairLane::forget(const crypto::IdentityName& sender) {
  const auto organisation = organisations_.find(sender.msp_id);
  if (organisation != organisations_.end()) organisation->second.tags.erase(sender);
}

}  // namespace ledgerline::node
