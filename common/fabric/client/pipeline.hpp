#pragma once
#include <grpcpp/alarm.h>

#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "common/fabric/client/endorsement_stage.hpp"
#include "common/fabric/client/ordering.hpp"

namespace ledgerline::fabric {

/// Endorse -> sign -> Submit -> CommitStatus for many calls at once, on one thread with one completion queue; that
/// thread alone touches the calls, so they need no lock.
///
///     submit() -> inbox -> endorsing -> ready -> sent -> acknowledged -> done
///                             ^  |  refused, unavailable: done
///                             +--+ back-off (nothing is ordered yet, so asking again is safe)
///
/// Order: proposals are endorsed side by side, but only one Submit is on its way at a time, in the order of submit();
/// the next one leaves when the orderer has acknowledged the one before or it has failed. So the ledger orders one
/// client's transactions as they were submitted (those with EndorsementNeed::in_order). The gateway's Submit is never
/// repeated: where its answer is lost, CommitStatus reports it (an envelope for an orderer may be sent twice:
/// ordering.hpp). That one is asked together with Submit, which saves a round trip; not at all, where a block stream of
/// the same client reports in time and the call allows it (Call::reported_by_block).
///
/// With orderers in the config the call goes the direct path: ProcessProposal at a peer in place of Endorse
/// (EndorsementStage), Broadcast in place of Submit; where no orderer is reached, the gateway's Submit after all.
class Pipeline {
 public:
  explicit Pipeline(std::shared_ptr<const Connection> connection);
  /// Ends what is in flight as unavailable.
  ~Pipeline();
  void submit(Call call, std::function<void(Outcome)> done);

 private:
  using Time = std::chrono::system_clock::time_point;
  enum class Stage { endorsing, ready, sent, acknowledged, finished };
  struct Pending : EndorsementRequest {
    std::uint64_t number = 0;
    Call call;
    std::function<void(Outcome)> done;
    Stage stage = Stage::endorsing;
    std::shared_ptr<const crypto::SigningIdentity> self;  ///< whom it is signed as, all of it
    std::string envelope;                                 ///< signed
    std::string answer;
    std::string submit_problem;  ///< why it is not known whether Submit arrived
    TimeNs begun_ns = 0, endorsed_ns = 0, sent_ns = 0, ordered_ns = 0;
    bool awaited = false;                  ///< a block stream is to report its end
    std::optional<std::size_t> orderer{};  ///< that it was sent to, and no other
    std::shared_ptr<UnaryCall<gateway::SubmitResponse>> submit;
    std::shared_ptr<UnaryCall<gateway::CommitStatusResponse>> status;
  };
  using PendingPtr = std::shared_ptr<Pending>;
  struct Job {
    Call call;
    std::function<void(Outcome)> done;
    Time deadline;
  };

  void run();
  /// With mutex_ held: whether the thread is to be woken, by wake() behind the mutex, which it takes at once.
  bool must_wake() { return !stopping_ && !std::exchange(woken_, true); }
  /// Has the thread read the inbox.
  void wake();
  void read_inbox();
  void read_commits();
  void renew_channels();
  void begin(Job job);
  void on_endorsed(const PendingPtr& p, const Result<std::string>& unsigned_envelope);
  void send_next();
  void send(const PendingPtr& p);
  void submit_through_gateway(const PendingPtr& p);
  void on_submitted(const PendingPtr& p);
  void on_ordered(const PendingPtr& p, Ordering::Ended ended, const std::string& why);
  void await_commit(const PendingPtr& p);
  void request_status(const PendingPtr& p);
  void on_status(const PendingPtr& p);
  void finish(const PendingPtr& p, Outcome::Kind kind, const std::string& message);
  void finish(const PendingPtr& p, Outcome outcome);
  void end_all();

  const std::shared_ptr<const Connection> connection_;
  grpc::CompletionQueue queue_;

  std::mutex mutex_;  ///< guards the three below
  std::vector<Job> inbox_;
  bool woken_ =
      false;  ///< somebody sets, or has set, an alarm that ends in read_inbox(), which alone shuts the queue down
  bool stopping_ = false;

  // The thread's own.
  EndorsementStage endorsement_;
  std::optional<Ordering> ordering_;  ///< on the direct path
  std::uint64_t next_number_ = 0;
  std::map<std::uint64_t, PendingPtr> live_;
  std::deque<PendingPtr> order_;  ///< not yet acknowledged, oldest first
  std::thread thread_;
};

}  // namespace ledgerline::fabric
