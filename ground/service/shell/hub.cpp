#include "ground/service/shell/hub.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace ledgerline::ground::service {

void Hub::publish(std::string drones, std::shared_ptr<const std::string> state, std::vector<Event> events) {
  drones_ = std::move(drones);
  state_ = std::move(state);
  for (Event& event : events) events_.push_back(std::move(event));
  while (events_.size() > Server::max_events) events_.pop_front();
  tell();
}

void Hub::end() {
  ended_ = true;
  tell();
}

void Hub::tell() {
  listeners_.erase(std::remove_if(listeners_.begin(), listeners_.end(), [](const auto& one) { return one.expired(); }),
                   listeners_.end());
  for (const auto& one : listeners_) {
    if (const auto listener = one.lock()) listener->news();
  }
}

std::string Hub::greeting() const {
  return fmt::format(R"({{"op":"hello","version":1,"manual":{},"speed_mps":{:.3f},"cmd_timeout_ms":{:.0f}}})",
                     greeting_.manual, greeting_.speed_mps, to_ms(greeting_.cmd_timeout_ns));
}

}  // namespace ledgerline::ground::service
