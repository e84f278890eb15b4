#pragma once
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "common/rt/mailbox.hpp"
#include "ground/shell/channel.hpp"

namespace ledgerline::ground {

/// What other threads hand over to the flight's thread, which wakes for it: events in their order, and what pilots
/// command. put(), put_in_turn(), post_command() and wake(): any thread; the rest: the flight's.
class Inbox {
 public:
  struct ChannelUpdate {
    std::size_t channel;
    Channel::Update update;
  };
  /// What an operator's call came to, or what else people should know.
  struct Report {
    Level level;
    std::string drone;  ///< its name; empty: of none
    std::string words;
  };
  /// An operator's session began, or is over.
  struct SessionChange {
    std::size_t who;
    bool in;
  };
  using Event = std::variant<ChannelUpdate, Report, SessionChange>;

  void put(Event event) { mailbox_.put(std::move(event)); }
  /// The same; the caller waits while the mailbox is full, so that a stream slows down.
  void put_in_turn(Event event) { mailbox_.put_in_turn(std::move(event)); }
  void wake() { mailbox_.wake(); }
  /// Nobody waits any longer.
  void close() { mailbox_.close(); }
  /// Changes what is commanded of a drone; `by`: the operator; none: any client.
  void post_command(std::size_t drone, const std::optional<crypto::IdentityName>& by,
                    const std::function<void(PilotCommand&)>& change);
  void post_command(const PilotCommand& one);

  std::optional<Event> next(TimeNs timeout_ns);
  /// These come before all that wait.
  void put_first(std::vector<Event> events);
  /// There is another event already, and it may be of that channel.
  bool has_more_for(std::size_t channel);
  /// What was commanded since the last time: at most one for each drone and operator.
  std::vector<PilotCommand> pop_commands();

 private:
  Mailbox<Event> mailbox_;    ///< blocks in turn; of outcomes there are as many as calls in flight
  std::deque<Event> events_;  ///< taken out of it
  std::mutex commands_mutex_;
  std::vector<PilotCommand> commands_;
};

}  // namespace ledgerline::ground
