#pragma once
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "common/fabric/client/client.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/rt/mailbox.hpp"
#include "common/rt/retry.hpp"
#include "common/rt/workers.hpp"
#include "common/verification/control_records.hpp"
#include "ground/service/core/api.hpp"
#include "ground/service/missions/approvals.hpp"
#include "ground/service/operators/ended_sessions.hpp"
#include "ground/service/operators/sign_ins.hpp"
#include "ground/service/shell/server.hpp"

namespace ledgerline::ground {

/// The operators' keys: each is unlocked by its pass phrase for as long as its session lasts, and signs what its
/// operator asks for through two clients of its own on each channel: one for leases, one for stops, which must not wait
/// behind them. Keys stay in this process. Any thread.
class OperatorService final : public service::OperatorKeys {
 public:
  struct Parts {
    std::string folder;  ///< of the operators, an MSP folder each, whose key is locked
    /// Of each channel, as ground's own, whose identity commands under the operators' leases; that of [ledger] first.
    std::vector<fabric::ClientConfig> ledgers;
    std::vector<std::string> drones;  ///< names, in the config's order
    std::function<std::size_t(std::size_t drone)> channel_of;
    /// Clears ground's own stop, signed by ground, on that channel; waits for what comes of it. On the worker.
    std::function<fabric::Outcome(std::size_t channel, const fabric::Call& call)> clear_ground_stop;
    /// What became of a call; `drone`: its name, empty: of none. On a thread of the service.
    std::function<void(service::Level level, const std::string& drone, std::string words)> report;
    /// A session began (true), or is over. On the thread that says so.
    std::function<void(std::size_t who, bool in)> on_session;
  };
  static constexpr std::size_t max_operators = 64, max_waiting = 32;

  static Result<std::unique_ptr<OperatorService>> create(Parts parts);
  ~OperatorService() override { close(); }

  const std::vector<service::Operator>& operators() const override { return operators_; }
  void unlock(std::size_t who, std::shared_ptr<const crypto::WipingString> pass_phrase,
              std::function<void(Status)> answer) override;
  void on_session_over(std::size_t who) override;
  Status submit(std::size_t who, const service::OperatorCall& call) override;
  /// A stop, at once; `ended` comes exactly once. False: his key is locked, and nothing comes.
  bool stop(const crypto::IdentityName& who, std::size_t channel, const fabric::Call& call,
            std::function<void(fabric::Outcome)> ended);
  /// Behind the calls that wait: gives these drones back, and what he has taken by then, and forgets his key. False:
  /// too much waits.
  bool end_session(std::size_t who, const std::vector<std::size_t>& drones);
  /// Forgets his key at once: nothing more is signed with it.
  void forget(std::size_t who) { set_clients(who, {}); }
  /// Nothing is unlocked or submitted from here on; what waits is refused.
  void close();

 private:
  struct Pair {
    std::shared_ptr<fabric::Client> leases, stops;
  };
  struct Clients {
    std::vector<Pair> of_channel;  ///< empty: the key is locked
    bool left = false;             ///< the session ended: of the waiting calls only releases are signed
  };

  explicit OperatorService(Parts parts) : parts_(std::move(parts)) {}
  /// On the worker.
  Status open_key(std::size_t who, const crypto::WipingString& pass_phrase);
  void sign(std::size_t who, const service::OperatorCall& call);
  Clients clients_of(std::size_t who) const;
  void set_clients(std::size_t who, Clients clients);

  const Parts parts_;
  std::vector<service::Operator> operators_;
  std::vector<std::string> folders_;  ///< of each
  mutable std::mutex clients_mutex_;
  std::vector<Clients> clients_;  ///< of each
  std::atomic<bool> closed_{false};
  Workers worker_{"operators", 1, max_waiting};
};

/// Which operators may sign nothing any more, as the roles of one channel say: read from the ledger at first and when a
/// block changes some. An event is anybody's word, so what counts is what is read. It is read by a thread of its own;
/// all methods are the flight's thread's.
class RoleWatch {
 public:
  static constexpr TimeNs gap_ns = 2 * ns_per_s;  ///< between two readings, also where one has failed
  struct Parts {
    std::vector<service::Operator> operators;
    verification::Evaluate evaluate;  ///< on the thread
    std::function<void()> wake;       ///< the flight's thread shall step()
  };

  explicit RoleWatch(Parts parts) : parts_(std::move(parts)) { wanted_.request(); }
  ~RoleWatch() { close(); }

  void on_block(const fabric::Block& block);
  /// Indexes of those who are dismissed, as is known by now.
  const std::vector<std::size_t>& step(TimeNs now);
  /// Nothing is read from here on; waits for one question to the ledger at most.
  void close();

 private:
  const Parts parts_;
  RateLimiter wanted_{gap_ns};
  bool is_reading_ = false;
  std::vector<std::size_t> dismissed_;
  std::atomic<bool> closed_{false};
  Mailbox<Result<verification::RolesByOrganisation>> read_;
  Workers worker_{"roles", 1, 1};
};

/// The sessions of operators: they end with the operator's role, and of one who has left what he holds is landed and
/// given back before his key is forgotten. The flight's thread.
class OperatorSessions {
 public:
  struct Parts {
    const FlightView& view;
    std::unique_ptr<OperatorService> service;
    std::vector<verification::Evaluate> ledgers;  ///< of each channel, whose roles count; on a thread for each
    std::function<void()> wake;                   ///< the flight's thread shall step()
    TimeNs idle_ns = 0;                           ///< a session ends when it was idle for so long
    std::function<void(const PilotCommand& command)> post_command;
    std::function<void(const std::string& words)> warn;
    /// The indexes of all who may sign nothing any more, where they are others than before.
    std::function<void(const std::vector<std::size_t>& who)> dismiss;
    /// Of each who may not, each time: what he owns may change meanwhile.
    std::function<void(const crypto::IdentityName& who)> disown;
  };

  explicit OperatorSessions(Parts parts);

  OperatorService& keys() { return *parts_.service; }
  /// For operators of whom an earlier ground held drones, and who may come back for them.
  void await_all(TimeNs now_ns);
  void change(std::size_t who, bool in, TimeNs now_ns);
  bool has_left(std::size_t who) const { return ended_.has(who); }
  /// A block of that channel, which may change roles.
  void on_block(std::size_t channel, const fabric::Block& block) { roles_[channel]->on_block(block); }
  void step(TimeNs now_ns);
  /// Nothing is signed or read from here on.
  void close();

 private:
  void dismiss(TimeNs now_ns);
  void end_sessions(TimeNs now_ns);

  const Parts parts_;
  service::EndedSessions ended_;
  std::vector<std::size_t> dismissed_;             ///< as said last
  std::vector<std::unique_ptr<RoleWatch>> roles_;  ///< of each channel
};

}  // namespace ledgerline::ground
