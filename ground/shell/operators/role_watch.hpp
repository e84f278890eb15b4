#pragma once
#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "common/fabric/tx/transaction.hpp"
#include "common/rt/mailbox.hpp"
#include "common/rt/workers.hpp"
#include "common/verification/roles.hpp"
#include "ground/service/missions/approvals.hpp"
#include "ground/service/operators/sign_ins.hpp"

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
  service::Spaced wanted_{gap_ns};
  bool is_reading_ = false;
  std::vector<std::size_t> dismissed_;
  std::atomic<bool> closed_{false};
  Mailbox<Result<verification::Roles>> read_;
  Workers worker_{1, 1};
};

}  // namespace ledgerline::ground
