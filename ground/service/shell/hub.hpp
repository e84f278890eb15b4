#pragma once
#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "ground/service/core/api.hpp"
#include "ground/service/shell/server.hpp"

namespace ledgerline::ground::service {

/// What all connections share: the newest state, the newest events, and who listens to the stream. The server's thread
/// only, but for connections().
class Hub {
 public:
  Hub(std::vector<std::string> drones, const Greeting& greeting, Server::TakeWish take)
      : names_(std::move(drones)), greeting_(greeting), take_(std::move(take)) {}

  /// Somebody who is told that there is news.
  class Listener {
   public:
    virtual ~Listener() = default;
    virtual void news() = 0;
  };

  void publish(std::string drones, std::shared_ptr<const std::string> state, std::vector<Event> events);
  /// Nothing more is published.
  void end();
  bool ended() const { return ended_; }
  void join(const std::shared_ptr<Listener>& listener) { listeners_.push_back(listener); }

  const std::vector<std::string>& names() const { return names_; }
  Known known() const { return {names_, drones_, events_}; }
  const std::deque<Event>& events() const { return events_; }
  std::uint64_t newest_event() const { return events_.empty() ? 0 : events_.back().number; }
  const std::shared_ptr<const std::string>& state() const { return state_; }
  std::string greeting() const;
  void take(const PilotWish& wish) const { take_(wish); }

  /// Counts a connection while it lives.
  class Place {
   public:
    explicit Place(Hub& hub) : hub_(&hub) { ++hub_->connections_; }
    ~Place() {
      if (hub_) --hub_->connections_;
    }
    Place(Place&& other) noexcept : hub_(std::exchange(other.hub_, nullptr)) {}
    Place(const Place&) = delete;
    Place& operator=(const Place&) = delete;
    Place& operator=(Place&&) = delete;

   private:
    Hub* hub_;
  };
  /// Any thread.
  std::size_t connections() const { return connections_; }

 private:
  void tell();

  const std::vector<std::string> names_;
  const Greeting greeting_;
  const Server::TakeWish take_;
  std::string drones_ = "[]";
  std::shared_ptr<const std::string> state_;
  std::deque<Event> events_;
  std::vector<std::weak_ptr<Listener>> listeners_;
  bool ended_ = false;
  std::atomic<std::size_t> connections_{0};
};

}  // namespace ledgerline::ground::service
