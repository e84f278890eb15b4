#pragma once
#include <atomic>
#include <deque>
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

/// The connections that are open: how many, who keeps a place, and which unauthenticated one goes when there are too
/// many. The server's thread only, but for count().
class Connections {
 public:
  /// Counts a connection while it lives.
  class Place {
   public:
    explicit Place(Connections& connections) : connections_(&connections) { ++connections_->count_; }
    ~Place() {
      if (connections_) --connections_->count_;
    }
    Place(Place&& other) noexcept : connections_(std::exchange(other.connections_, nullptr)) {}
    Place(const Place&) = delete;
    Place& operator=(const Place&) = delete;
    Place& operator=(Place&&) = delete;

   private:
    Connections* connections_;
  };
  /// Any thread.
  std::size_t count() const { return count_; }

  /// A place that its owner keeps for as long as this lives (Places).
  class KeptPlace {
   public:
    KeptPlace(Connections& connections, Places::Owner owner) : connections_(&connections), owner_(std::move(owner)) {}
    ~KeptPlace() {
      if (connections_) connections_->places_.release(owner_);
    }
    KeptPlace(KeptPlace&& other) noexcept
        : connections_(std::exchange(other.connections_, nullptr)), owner_(std::move(other.owner_)) {}
    KeptPlace(const KeptPlace&) = delete;
    KeptPlace& operator=(const KeptPlace&) = delete;
    KeptPlace& operator=(KeptPlace&&) = delete;
    const Places::Owner& owner() const { return owner_; }

   private:
    Connections* connections_;
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
  Places places_;
  std::deque<std::weak_ptr<Unauthenticated>> unauthenticated_;  ///< oldest first
  std::mt19937_64 random_{std::random_device{}()};              ///< of who is displaced
  std::atomic<std::size_t> count_{0};
};

/// What all connections share: the newest state, the newest events, and who listens to the stream. The server's thread
/// only, but for streams().
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
    return {.names = names_,
            .drones = newest_.drones,
            .paths = paths_,
            .events = events_,
            .operators = operators_,
            .faults = behind_.ask_faults ? &faults_ : nullptr,
            .aloft = newest_.aloft,
            .stopped_by_ground = newest_.stopped_by_ground};
  }
  const std::deque<Event>& events() const { return events_; }
  std::uint64_t newest_event() const { return events_.empty() ? 0 : events_.back().number; }
  /// The newest event that cannot be sent any more; 0: all can.
  std::uint64_t forgotten_event() const { return events_.empty() ? 0 : events_.front().number - 1; }
  /// What a client is sent whenever it is another one than it had; null: there is none yet.
  struct Messages {
    std::shared_ptr<const std::string> paths{}, missions{}, faults{}, state{};
  };
  const Messages& messages() const { return messages_; }
  std::string greeting() const;
  Status take(const PilotCommand& command) const { return behind_.take(command); }

  Connections& connections() { return connections_; }
  SignIns& sign_ins() { return sign_ins_; }
  const std::vector<Operator>& operators() const { return operators_; }
  OperatorKeys& keys() { return *behind_.keys; }
  const auto& ask_missions() const { return behind_.ask_missions; }
  const auto& ask_faults() const { return behind_.ask_faults; }
  /// Ends the sessions that were idle for too long.
  void expire(TimeNs now);

  /// Any thread.
  std::size_t streams() const { return streams_; }

 private:
  void tell();

  const std::vector<std::string> names_;
  const Greeting greeting_;
  const TimeNs started_ns_ = realtime_ns();
  const Server::Behind behind_;
  const std::vector<Operator> operators_;
  SignIns sign_ins_;
  Connections connections_;
  Telling newest_{.drones = "[]"};  ///< but for its paths and events, which are below
  std::string paths_ = "{}";
  Messages messages_;
  FaultList faults_{.switches = {}, .why = "the faults' switches were not reached yet"};
  std::deque<Event> events_;
  std::deque<BlockSummary> blocks_;
  std::vector<std::weak_ptr<Listener>> listeners_;
  bool ended_ = false;
  std::atomic<std::size_t> streams_{0};
};

}  // namespace ledgerline::ground::service
