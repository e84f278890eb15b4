#include "ground/shell/inbox.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

#include "ground/service/core/api.hpp"

namespace ledgerline::ground {

void Inbox::post_command(std::size_t drone, const std::optional<crypto::IdentityName>& by,
                         const std::function<void(PilotCommand&)>& change) {
  {
    const std::lock_guard lock(commands_mutex_);
    auto waiting =
        std::ranges::find_if(commands_, [&](const PilotCommand& w) { return w.drone == drone && w.by == by; });
    if (waiting == commands_.end()) waiting = commands_.insert(waiting, {.drone = drone, .by = by});
    change(*waiting);
  }
  mailbox_.wake();
}

void Inbox::post_command(const PilotCommand& one) {
  post_command(one.drone, one.by, [&](PilotCommand& waiting) { service::merge(one, waiting); });
}

std::optional<Inbox::Event> Inbox::next(TimeNs timeout_ns) {
  if (events_.empty()) {
    mailbox_.wait(timeout_ns);
    events_ = mailbox_.pop_all();
  }
  if (events_.empty()) return std::nullopt;
  Event event = std::move(events_.front());
  events_.pop_front();
  return event;
}

void Inbox::put_first(std::vector<Event> events) {
  events_.insert(events_.begin(), std::make_move_iterator(events.begin()), std::make_move_iterator(events.end()));
}

bool Inbox::has_more_for(std::size_t channel) {
  if (events_.empty()) events_ = mailbox_.pop_all();
  return std::ranges::any_of(events_, [&](const Event& event) {
    const auto* of = std::get_if<ChannelUpdate>(&event);
    return !of || of->channel == channel;
  });
}

std::vector<PilotCommand> Inbox::pop_commands() {
  const std::lock_guard lock(commands_mutex_);
  return std::exchange(commands_, {});
}

}  // namespace ledgerline::ground
