#pragma once
#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/string_body.hpp>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/rt/clock.hpp"
#include "common/web/wire.hpp"
#include "ground/service/core/api.hpp"
#include "ground/service/core/connection_quota.hpp"
#include "ground/service/core/guard.hpp"
#include "ground/service/shell/server.hpp"

namespace ledgerline::ground::service {

/// The connections that are open: how many, who keeps a place, and which unauthenticated one goes when there are too
/// many. The server's thread only, but for count().
class Connections {
 public:
  /// Counts a connection while it lives.
  using Count = std::shared_ptr<void>;
  Count count_one() {
    ++count_;
    return {this, [](Connections* connections) { --connections->count_; }};
  }
  /// Any thread.
  std::size_t count() const { return count_; }

  /// A slot that its owner keeps for as long as this lives (ConnectionQuota); null: there is none left for him.
  using Reservation = std::shared_ptr<const ConnectionQuota::Owner>;
  Reservation reserve(const ConnectionQuota::Owner& owner, ConnectionQuota::Use use);

  /// A connection that keeps no place: it has not shown the token, or there was none left.
  class Unauthenticated {
   public:
    virtual ~Unauthenticated() = default;
    virtual bool is_unauthenticated() const = 0;
    virtual UnauthenticatedClient now() const = 0;
    virtual void close() = 0;
  };
  void join(const std::shared_ptr<Unauthenticated>& client) { unauthenticated_.push_back(client); }
  /// For one more unauthenticated client: closes one where there are max_unauthenticated.
  void make_room();

 private:
  ConnectionQuota quota_;
  std::deque<std::weak_ptr<Unauthenticated>> unauthenticated_;  ///< oldest first
  std::mt19937_64 random_{std::random_device{}()};              ///< of who is displaced
  std::atomic<std::size_t> count_{0};
};

/// What all connections share: the newest state, the newest events, and who listens to the stream. The server's thread
/// only, but for streams().
class Hub {
 public:
  Hub(std::vector<std::string> drones, const Greeting& greeting, Server::Handlers handlers, TimeNs session_idle_ns);

  void publish_blocks(const std::vector<BlockSummary>& blocks);
  const std::deque<BlockSummary>& blocks() const { return blocks_; }
  std::uint64_t newest_block() const { return blocks_.empty() ? 0 : blocks_.back().number; }

  /// Somebody who is notified of updates.
  class Listener {
   public:
    virtual ~Listener() = default;
    virtual void on_update() = 0;
  };

  void publish(BoardState board);
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
            .faults = handlers_.request_fault ? &faults_ : nullptr,
            .aloft = newest_.aloft,
            .stopped = newest_.stopped,
            .stopped_by_ground = newest_.stopped_by_ground,
            .unplaced = newest_.unplaced,
            .leases = newest_.leases,
            .phases = newest_.phases,
            .manual = greeting_.manual,
            .fence = greeting_.fence ? &*greeting_.fence : nullptr,
            .height_m = greeting_.height_m,
            .now_ns = monotonic_ns()};
  }
  const std::deque<Event>& events() const { return events_; }
  std::uint64_t newest_event() const { return events_.empty() ? 0 : events_.back().number; }
  /// The newest event that cannot be sent any more; 0: all can.
  std::uint64_t forgotten_event() const { return events_.empty() ? 0 : events_.front().number - 1; }
  /// The newest message of each kind, sent to a client when it is not the one it had last; null: there is none yet.
  struct Messages {
    std::shared_ptr<const std::string> paths{}, missions{}, faults{}, state{};
  };
  const Messages& messages() const { return messages_; }
  std::string greeting() const;
  Status post_command(const PilotCommand& command) const { return handlers_.take(command); }

  Connections& connections() { return connections_; }
  SignIns& sign_ins() { return sign_ins_; }
  const std::vector<Operator>& operators() const { return operators_; }
  OperatorKeys& keys() { return *handlers_.keys; }
  const auto& request_mission() const { return handlers_.request_mission; }
  const auto& request_fault() const { return handlers_.request_fault; }
  /// Ends the sessions that were idle for too long.
  void expire(TimeNs now);

  /// Any thread.
  std::size_t streams() const { return streams_; }

 private:
  void notify();

  const std::vector<std::string> names_;
  const Greeting greeting_;
  const TimeNs started_ns_ = realtime_ns();
  const Server::Handlers handlers_;
  const std::vector<Operator> operators_;
  SignIns sign_ins_;
  Connections connections_;
  BoardState newest_{.drones = "[]"};  ///< but for its paths and events, which are below
  std::string paths_ = "{}";
  Messages messages_;
  FaultList faults_{.switches = {}, .why = "the faults' switches were not reached yet"};
  std::deque<Event> events_;
  std::deque<BlockSummary> blocks_;
  std::vector<std::weak_ptr<Listener>> listeners_;
  bool ended_ = false;
  std::atomic<std::size_t> streams_{0};
};

/// Brings what other threads answer to the server's thread. A connection that waits for an answer belongs to that
/// thread alone: another one neither uses nor ends it, whenever it answers. An answer behind the server's end is
/// dropped.
class Answers {
 public:
  explicit Answers(boost::asio::io_context& io) : door_(std::make_shared<AnswerGate>(io)) {}
  ~Answers() { close(); }
  Answers(const Answers&) = delete;
  Answers& operator=(const Answers&) = delete;

  /// What `then` gets is what the returned function is called with, once; `then` runs and ends on the server's thread.
  /// The returned function: any thread, and whenever it likes. Server's thread.
  template <typename Answer>
  std::function<void(Answer)> expect(std::function<void(Answer)> then) {
    const auto waits = std::make_shared<std::function<void(Answer)>>(std::move(then));
    waiting_.insert(waits);
    return [this, door = door_, waits = std::weak_ptr(waits)](Answer answer) {
      door->post([this, waits, answer = std::move(answer)]() mutable {
        const auto found = waits.lock();
        if (found && waiting_.erase(found) > 0) (*found)(std::move(answer));
      });
    };
  }

  /// Nobody waits any longer. When the server's thread has ended, and before its io_context does.
  void close() {
    door_->close();
    waiting_.clear();
  }

 private:
  class AnswerGate {
   public:
    explicit AnswerGate(boost::asio::io_context& io) : io_(&io) {}
    template <typename Work>
    void post(Work work) {
      const std::lock_guard lock(mutex_);
      if (io_) boost::asio::post(*io_, std::move(work));
    }
    void close() {
      const std::lock_guard lock(mutex_);
      io_ = nullptr;
    }

   private:
    std::mutex mutex_;
    boost::asio::io_context* io_;
  };

  const std::shared_ptr<AnswerGate> door_;
  std::set<std::shared_ptr<void>> waiting_;
};

/// Serves one connection until it ends: with TLS its handshake, requests one by one, or, behind an upgrade, the stream.
/// Hub, answers and guard outlive it.
void serve_http(web::Wire wire, Hub& hub, Answers& answers, const Guard& guard);

/// What a connection holds while its stream lasts.
struct StreamSlots {
  Connections::Count counted;
  Connections::Reservation kept;
};

/// Serves the stream behind that request for it, until it ends. `session`: of the operator who opened it. Hub outlives
/// it.
void serve_stream(web::Wire wire, Hub& hub, StreamSlots slots, std::optional<SignIns::Session> session,
                  const boost::beast::http::request<boost::beast::http::string_body>& request);

}  // namespace ledgerline::ground::service
