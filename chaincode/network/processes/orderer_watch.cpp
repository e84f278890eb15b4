#include "chaincode/network/processes/orderer_watch.hpp"

#include <cstring>

namespace ledgerline::fabric_network {

std::vector<std::string> OrdererWatch::update(TimeNs now, const std::vector<Processes::State>& states) {
  std::vector<std::string> hang;
  if (now < next_look_) return hang;
  next_look_ = now + between_ns;
  for (const Processes::State& state : states) {
    if (!state.name.starts_with("orderer") || state.pid == 0) continue;
    Watched& watched = watched_[state.name];
    if (watched.pid != state.pid) watched = {state.pid, StartCheck(channels_, limit_ns)};
    if (!watched.check) continue;
    const int number = std::stoi(state.name.substr(std::strlen("orderer")));
    const auto verdict = watched.check->update(now, signs_of_(number));  // one that ends is seen by itself
    if (verdict == StartCheck::Verdict::not_known) continue;
    watched.check.reset();
    if (verdict == StartCheck::Verdict::hangs) hang.push_back(state.name);
  }
  return hang;
}

}  // namespace ledgerline::fabric_network
