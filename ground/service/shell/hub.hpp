#pragma once
#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "common/rt/clock.hpp"
#include "ground/service/connections/places.hpp"
#include "ground/service/core/api.hpp"
#include "ground/service/shell/server.hpp"

namespace ledgerline::ground::service {

/// What all connections share: the newest state, the newest events, and who listens to the stream. The server's thread
/// only, but for connections() and streams().
class Hub {
 public:
  Hub(std::vector<std::string> drones, const Greeting& greeting, Server::Behind behind, TimeNs session_idle_ns);

  void publish_blocks(const std::vector<BlockSummary>& blocks);
  const std::deque<BlockSummary>& blocks() const { return blocks_; }
  std::uint64_t newest_block() const { return blocks_.empty() ? 0 : blocks_.back().number; }

  /// Somebody who is notified of news.
  class Listener {
   public:
    virtual ~Listener() = default;
    virtual void news() = 0;
  };

  void publish(Telling telling);
  void publish_missions(std::string_view list);
  void publish_faults(FaultList list);
  /// Nothing more is published.
  void end();
  bool ended() const { return ended_; }
  void join(const std::shared_ptr<Listener>& listener) {
    listeners_.push_back(listener);
    streams_ = listeners_.size();
  }

  const std::vector<std::string>& names() const { return names_; }
  ApiContext known() const {
    return {names_, drones_,           paths_, events_, operators_, behind_.ask_faults ? &faults_ : nullptr,
            aloft_, stopped_by_ground_};
  }
  const std::deque<Event>& events() const { return events_; }
  std::uint64_t newest_event() const { return events_.empty() ? 0 : events_.back().number; }
  /// The newest event that cannot be sent any more; 0: all can.
  std::uint64_t forgotten_event() const { return events_.empty() ? 0 : events_.front().number - 1; }
  const std::shared_ptr<const std::string>& state() const { return state_; }
  const std::shared_ptr<const std::string>& paths() const { return paths_message_; }
  const std::shared_ptr<const std::string>& missions() const { return missions_message_; }
  const std::shared_ptr<const std::string>& faults() const { return faults_message_; }
  std::string greeting() const;
  Status take(const PilotCommand& command) const { return behind_.take(command); }

  SignIns& sign_ins() { return sign_ins_; }
  const std::vector<Operator>& operators() const { return operators_; }
  OperatorKeys& keys() { return *behind_.keys; }
  const auto& ask_missions() const { return behind_.ask_missions; }
  const auto& ask_faults() const { return behind_.ask_faults; }
  /// Ends the sessions that were idle for too long.
  void expire(TimeNs now);

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
  std::size_t streams() const { return streams_; }

  /// A place that its owner keeps for as long as this lives (Places).
  class KeptPlace {
   public:
    KeptPlace(Hub& hub, Places::Owner owner) : hub_(&hub), owner_(std::move(owner)) {}
    ~KeptPlace() {
      if (hub_) hub_->places_.release(owner_);
    }
    KeptPlace(KeptPlace&& other) noexcept : hub_(std::exchange(other.hub_, nullptr)), owner_(std::move(other.owner_)) {}
    KeptPlace(const KeptPlace&) = delete;
    KeptPlace& operator=(const KeptPlace&) = delete;
    KeptPlace& operator=(KeptPlace&&) = delete;
    const Places::Owner& owner() const { return owner_; }

   private:
    Hub* hub_;
    Places::Owner owner_;
  };
  /// Nothing: there is no place left for him.
  std::optional<KeptPlace> keep(const Places::Owner& owner, Places::Use use);

  /// A connection that keeps no place: it has not shown the token, or there was none left.
  class Unauthenticated {
   public:
    virtual ~Unauthenticated() = default;
    virtual bool is_unauthenticated() const = 0;
    virtual UnauthenticatedClient now() const = 0;
    virtual void leave() = 0;
  };
  void join(const std::shared_ptr<Unauthenticated>& client) { unauthenticated_.push_back(client); }
  /// For one more unauthenticated client: closes one where there are max_unauthenticated.
  void make_room();

 private:
  void tell();

  const std::vector<std::string> names_;
  const Greeting greeting_;
  const TimeNs started_ns_ = realtime_ns();
  const Server::Behind behind_;
  const std::vector<Operator> operators_;
  SignIns sign_ins_;
  std::string drones_ = "[]", paths_ = "{}";
  std::shared_ptr<const std::string> state_, paths_message_, missions_message_, faults_message_;
  FaultList faults_{.switches = {}, .why = "the faults' switches were not reached yet"};
  std::vector<std::size_t> aloft_, stopped_by_ground_;
  std::deque<Event> events_;
  std::deque<BlockSummary> blocks_;
  std::vector<std::weak_ptr<Listener>> listeners_;
  std::deque<std::weak_ptr<Unauthenticated>> unauthenticated_;  ///< oldest first
  Places places_;
  std::mt19937_64 random_{std::random_device{}()};  ///< of who is displaced
  bool ended_ = false;
  std::atomic<std::size_t> connections_{0}, streams_{0};
};

}  // namespace ledgerline::ground::service
