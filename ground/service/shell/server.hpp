#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "ground/mission/check.hpp"
#include "ground/service/core/api.hpp"
#include "ground/service/core/blocks.hpp"
#include "ground/service/core/guard.hpp"

namespace ledgerline::ground::service {

/// The token in that file, which is made where there is none. An error: it holds no token, or others may read it.
Result<std::string> read_token(const std::string& file);

/// What a client of the stream hears first.
struct Greeting {
  bool manual = false;
  double speed_mps = 0, height_m = 1;
  TimeNs cmd_timeout_ns = 0;
  std::optional<mission::Fence> fence{};  ///< of missions and paths; nothing: none is known
};

/// The operators' keys, behind the station. Called on the server's thread.
class OperatorKeys {
 public:
  virtual ~OperatorKeys() = default;
  virtual const std::vector<Operator>& operators() const = 0;
  /// Unlocks a key on a thread of its own, where `answer` is called, too.
  virtual void unlock(std::size_t who, std::shared_ptr<const crypto::WipingString> pass_phrase,
                      std::function<void(Status)> answer) = 0;
  /// His session is over: what he holds is landed and given back, and his key is forgotten.
  virtual void on_session_over(std::size_t who) = 0;
  /// Signs and submits; what comes of it is reported as an event. The error says why it cannot now.
  virtual Status submit(std::size_t who, const OperatorCall& call) = 0;
};

/// HTTP and WebSocket, with or without TLS, for page, command line and scripts, on a thread of its own: whatever
/// clients do, the flight's thread only hands over two texts. A client gets the newest state, and every event in order;
/// one that does not read is closed when it is max_events behind.
class Server {
 public:
  static constexpr std::size_t max_events = 1000;
  /// What stands behind it, and must outlive it; an answer behind the server's end is dropped. Called on the server's
  /// thread.
  struct Handlers {
    /// A pilot's word; the error says why it is not taken now.
    std::function<Status(const PilotCommand&)> take;
    OperatorKeys* keys = nullptr;  ///< null: nobody signs in
    /// A question about missions; `answer` comes once, on any thread. Null: there are none.
    std::function<void(MissionRequest asked, std::function<void(ApiAnswer)> answer)> request_mission{};
    /// A fault is to be switched; `answer` comes once, on any thread. Null: there are none.
    std::function<void(FaultRequest asked, std::function<void(ApiAnswer)> answer)> request_fault{};
    /// Something that people should know of the service itself. Null: the log alone has it.
    std::function<void(Level level, std::string words)> report{};
  };

  /// Listens.
  static Result<std::unique_ptr<Server>> start(const ServiceSettings& settings, std::vector<std::string> drones,
                                               const Greeting& greeting, Handlers handlers);
  virtual ~Server() = default;

  /// Any thread; does not wait for clients.
  virtual void publish(BoardState board) = 0;
  /// [MISSION...], when one has changed. Any thread.
  virtual void publish_missions(std::string list) = 0;
  /// When they have changed. Any thread.
  virtual void publish_faults(FaultList list) = 0;
  /// These operators, of all, may sign nothing any more: their sessions end, and they do not sign in. Any thread.
  virtual void dismiss(std::vector<std::size_t> who) = 0;
  /// The last words: every client that reads gets what it lacks of the events, then a close frame; half a second at
  /// most.
  virtual void end() = 0;
  /// A stream is open: it pays to publish often.
  virtual bool watched() const = 0;
  /// Any thread; does not wait for clients. A client is sent what it lacks of the newest max_reported_blocks.
  virtual void publish_blocks(std::vector<BlockSummary> blocks) = 0;
  /// "http://127.0.0.1:8800", "https://ground.example.org:8800"
  virtual std::string url() const = 0;
};

}  // namespace ledgerline::ground::service
