#include "ground/service/shell/hub.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace ledgerline::ground::service {

Connections::Reservation Connections::reserve(const ConnectionQuota::Owner& owner, ConnectionQuota::Use use) {
  if (!quota_.acquire(owner, use)) return nullptr;
  return {new ConnectionQuota::Owner(owner), [this](const ConnectionQuota::Owner* kept) {
            quota_.release(*kept);
            delete kept;
          }};
}

void Connections::make_room() {
  if (unauthenticated_.size() < max_unauthenticated) return;
  std::vector<std::shared_ptr<Unauthenticated>> here;
  std::vector<UnauthenticatedClient> now;
  for (const auto& one : unauthenticated_) {
    auto client = one.lock();
    if (!client || !client->is_unauthenticated()) continue;
    now.push_back(client->now());
    here.push_back(std::move(client));
  }
  if (here.size() >= max_unauthenticated) {
    const auto displaced = here.begin() + static_cast<std::ptrdiff_t>(displaced_by_next(now, random_()));
    (*displaced)->close();
    here.erase(displaced);
  }
  unauthenticated_.assign(here.begin(), here.end());
}

Hub::Hub(std::vector<std::string> drones, const Greeting& greeting, Server::Handlers handlers, TimeNs session_idle_ns)
    : names_(std::move(drones)),
      greeting_(greeting),
      handlers_(std::move(handlers)),
      operators_(handlers_.keys ? handlers_.keys->operators() : std::vector<Operator>()),
      sign_ins_(operators_.size(), session_idle_ns) {}

void Hub::expire(TimeNs now) {
  for (const std::size_t who : sign_ins_.expire(now)) handlers_.keys->on_session_over(who);
}

void Hub::publish(BoardState board) {
  messages_.state = std::make_shared<const std::string>(std::move(board.state));
  if (board.paths) {
    paths_ = std::move(*board.paths);
    messages_.paths = std::make_shared<const std::string>(paths_message(paths_));
  }
  for (Event& event : board.events) events_.push_back(std::move(event));
  board.events.clear();
  newest_ = std::move(board);
  while (events_.size() > Server::max_events) events_.pop_front();
  notify();
}

void Hub::publish_blocks(const std::vector<BlockSummary>& blocks) {
  blocks_.insert(blocks_.end(), blocks.begin(), blocks.end());
  while (blocks_.size() > max_reported_blocks) blocks_.pop_front();
  notify();
}

void Hub::publish_missions(std::string_view list) {
  messages_.missions = std::make_shared<const std::string>(missions_message(list));
  notify();
}

void Hub::publish_faults(FaultList list) {
  messages_.faults = std::make_shared<const std::string>(faults_message(list));
  faults_ = std::move(list);
  notify();
}

void Hub::end() {
  ended_ = true;
  notify();
}

void Hub::notify() {
  listeners_.erase(std::remove_if(listeners_.begin(), listeners_.end(), [](const auto& one) { return one.expired(); }),
                   listeners_.end());
  streams_ = listeners_.size();
  for (const auto& one : listeners_) {
    if (const auto listener = one.lock()) listener->on_update();
  }
}

std::string Hub::greeting() const {
  const std::optional<mission::Fence>& box = greeting_.fence;
  const std::string fence = box ? fmt::format(R"({{"min_m":[{:.3f}],"max_m":[{:.3f}]}})", fmt::join(box->min_m, ","),
                                              fmt::join(box->max_m, ","))
                                : "null";
  return fmt::format(
      R"({{"op":"hello","version":1,"started_ms":{},"manual":{},"speed_mps":{:.3f},"cmd_timeout_ms":{:.0f},"fence":{}}})",
      started_ns_ / ns_per_ms, greeting_.manual, greeting_.speed_mps, to_ms(greeting_.cmd_timeout_ns), fence);
}

}  // namespace ledgerline::ground::service
