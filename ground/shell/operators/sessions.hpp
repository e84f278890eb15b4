#pragma once
#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/fabric/tx/transaction.hpp"
#include "common/rt/mailbox.hpp"
#include "common/rt/workers.hpp"
#include "common/verification/control_records.hpp"
#include "ground/service/missions/approvals.hpp"
#include "ground/service/operators/leaving.hpp"
#include "ground/service/operators/sign_ins.hpp"
#include "ground/shell/operators/operator_service.hpp"

namespace ledgerline::ground {

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

  explicit RoleWatch(Parts parts) : parts_(std::move(parts)) { wanted_.want(); }
  ~RoleWatch() { close(); }

  void look(const fabric::Block& block);
  /// Indexes of those who are dismissed, as is known by now.
  const std::vector<std::size_t>& step(TimeNs now);
  /// Nothing is read from here on; waits for one question to the ledger at most.
  void close();

 private:
  const Parts parts_;
  service::RateLimiter wanted_{gap_ns};
  bool is_reading_ = false;
  std::vector<std::size_t> dismissed_;
  std::atomic<bool> closed_{false};
  Mailbox<Result<verification::Roles>> read_;
  Workers worker_{1, 1};
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
  bool has_left(std::size_t who) const { return leaving_.has(who); }
  /// A block of that channel, which may change roles.
  void look(std::size_t channel, const fabric::Block& block) { roles_[channel]->look(block); }
  void step(TimeNs now_ns);
  /// Nothing is signed or read from here on.
  void close();

 private:
  void dismiss(TimeNs now_ns);
  void end_sessions(TimeNs now_ns);

  const Parts parts_;
  service::Leaving leaving_;
  std::vector<std::size_t> dismissed_;             ///< as said last
  std::vector<std::unique_ptr<RoleWatch>> roles_;  ///< of each channel
};

}  // namespace ledgerline::ground
