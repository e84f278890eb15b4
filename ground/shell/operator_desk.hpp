#pragma once
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "common/fabric/client/client.hpp"
#include "common/rt/mailbox.hpp"
#include "ground/service/core/api.hpp"
#include "ground/service/shell/server.hpp"

namespace ledgerline::ground {

/// The operators' keys: each is unlocked by its pass phrase for as long as its session lasts, and signs what its operator
/// asks for through two clients of its own: one for leases, one for stops, which must not wait behind them. Keys stay in
/// this process. Any thread.
class OperatorDesk final : public service::OperatorKeys {
 public:
  struct Parts {
    std::string folder;               ///< of the operators, an MSP folder each, whose key is locked
    fabric::ClientConfig ledger;      ///< as ground's own, whose identity commands under the operators' leases
    std::vector<std::string> drones;  ///< names, as FlightConfig has them
    /// What became of a call. On a thread of the desk.
    std::function<void(service::Level level, std::size_t drone, std::string words)> tell;
    /// A session began (true), or is over. On the thread that says so.
    std::function<void(std::size_t who, bool in)> on_session;
  };
  static constexpr std::size_t max_operators = 64, max_waiting = 32;

  static Result<std::unique_ptr<OperatorDesk>> create(Parts parts);
  ~OperatorDesk() override { close(); }

  const std::vector<service::Operator>& operators() const override { return operators_; }
  void unlock(std::size_t who, std::string pass_phrase, std::function<void(Status)> answer) override;
  void leave(std::size_t who) override { parts_.on_session(who, false); }
  Status submit(std::size_t who, const service::OperatorCall& call) override;
  /// A stop, at once; `ended` comes exactly once, at once where he is not signed in.
  void stop(const crypto::IdentityName& who, fabric::Call call, std::function<void(fabric::Outcome)> ended);
  /// Forgets his key, behind the calls that wait.
  void forget(std::size_t who);
  /// Nothing is unlocked or submitted from here on; what waits is thrown away.
  void close();

 private:
  struct Unlock {
    std::size_t who = 0;
    std::string pass_phrase;
    std::function<void(Status)> answer;
  };
  struct Sign {
    std::size_t who = 0;
    service::OperatorCall call;
  };
  struct Forget {
    std::size_t who = 0;
  };
  using Task = std::variant<Unlock, Sign, Forget>;
  struct Clients {
    std::shared_ptr<fabric::Client> leases, stops;
  };

  explicit OperatorDesk(Parts parts) : parts_(std::move(parts)) {}
  void work(const std::stop_token& quit);
  void run(Unlock& task);
  void run(Sign& task);
  void run(Forget& task);
  Clients clients_of(std::size_t who) const;
  void set_clients(std::size_t who, Clients clients);

  const Parts parts_;
  std::vector<service::Operator> operators_;
  std::vector<std::string> folders_;  ///< of each
  mutable std::mutex clients_mutex_;
  std::vector<Clients> clients_;  ///< of each; null: locked
  std::atomic<std::size_t> waiting_{0};
  Mailbox<Task> tasks_;
  std::jthread worker_;
};

}  // namespace ledgerline::ground
