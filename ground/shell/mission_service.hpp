#pragma once
#include <atomic>
#include <deque>
#include <functional>
#include <string>

#include "common/fabric/client/client.hpp"
#include "common/rt/mailbox.hpp"
#include "common/rt/retry.hpp"
#include "common/rt/workers.hpp"
#include "ground/service/missions/approvals.hpp"
#include "ground/service/missions/book.hpp"

namespace ledgerline::ground {

/// The shell around MissionBook: what takes long (reading a mission, checking it, asking the ledger who approved it,
/// keeping it on the disk) is done by a worker, and comes back to the flight's thread, whose the book is.
class MissionService {
 public:
  using Answer = std::function<void(service::ApiAnswer)>;
  struct Parts {
    service::MissionSettings settings;
    const FlightView& flights;
    fabric::Client& client;  ///< to ask, and for what ground's own identity anchors
    /// Has an operator sign his approval; the error says why he cannot now.
    std::function<Status(std::size_t who, const service::OperatorCall& call)> sign;
    std::function<bool(std::size_t who)> signed_in;  ///< on the flight's thread
    std::function<void(const PilotCommand& command)> post_command;
    std::function<void(Level level, const std::string& drone, const std::string& words)> report;
    std::function<void(const std::string& words)> report_request;  ///< who asked for what; on the flight's thread
    std::function<void(std::string list)> publish;                 ///< [MISSION...]
    std::function<void()> wake;                                    ///< the flight's thread shall step()
  };
  static constexpr std::size_t max_waiting = 32;

  explicit MissionService(Parts parts)
      : parts_(std::move(parts)),
        book_(parts_.settings, parts_.flights.config().self),
        terms_(parts_.flights.config().self, parts_.settings.approval_s) {}
  /// Reads what an earlier ground kept. An error: the folder cannot be read; a file that is no mission is said and
  /// left.
  Status restore();
  ~MissionService() { close(); }

  /// Any thread; `answer` comes exactly once, on a thread of the service's or of the flight's.
  void request(service::MissionRequest asked, Answer answer);
  /// A block of the ledger, which may approve.
  void on_block(const fabric::Block& block);
  /// Somebody is no operator any more.
  void disown(const crypto::IdentityName& owner) { book_.disown(owner); }
  /// Behind FlightCore's step.
  void step(TimeNs now);
  /// What waits for the worker is dropped, but for what goes to the disk; it waits for one question to the ledger at
  /// most.
  void close();

 private:
  using Task = std::function<void()>;
  using Checked = service::MissionBook::Checked;
  void later(Task task);  ///< on the flight's thread
  void add(const service::MissionRequest& asked, const Answer& answer);
  void add_run(mission::MissionRun run, const std::optional<crypto::IdentityName>& by, const Answer& answer);
  Result<std::string> query_ledger(const fabric::Call& call);  ///< on the worker
  void check(const mission::Mission& mission, std::function<void(Checked)> then);
  using Begin = Status (service::MissionBook::*)(const std::string&, const std::optional<crypto::IdentityName>&,
                                                 const Checked&, const FlightView&);
  /// Reads who approves it now, checks that part of the mission, and begins it.
  void fly(const mission::Mission& part, Begin begin, const service::MissionRequest& asked, const Answer& answer);
  void read_signers(const std::string& id) { read_signers(id, nullptr); }
  /// `then` (may be null): on the flight's thread, behind what was read; why it could not be.
  void read_signers(const std::string& id, std::function<void(const Status& read)> then);
  void answer_on_flight(const service::MissionRequest& asked, const Answer& answer);
  void anchor(const service::MissionRequest& asked, const Answer& answer);
  void save(const std::string& id);
  void forget(const std::string& id);
  void write_record(const std::string& id);
  std::string file_of(const std::string& id) const { return parts_.settings.folder + "/" + id + ".json"; }

  Parts parts_;
  service::MissionBook book_;
  const service::ApprovalTerms terms_;
  std::int64_t period_ = 0;                           ///< of approvals, as looked at last
  service::Unread unread_;                            ///< whose signers could not be read
  RateLimiter all_again_{service::Unread::again_ns};  ///< all signers are read, since roles have changed
  Mailbox<Task> tasks_;       ///< for the flight's thread; at most as many as requests and tasks of the worker
  std::deque<Task> waiting_;  ///< taken out of it
  std::atomic<bool> closed_{false};
  Workers disk_{"mission files", 1, max_waiting};  ///< keeps and forgets: a few files, which are soon written
  Workers worker_{"missions", 1, max_waiting};     ///< reads, checks and asks the ledger
};

}  // namespace ledgerline::ground
