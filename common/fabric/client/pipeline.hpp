#pragma once
#include <grpcpp/alarm.h>

#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "common/fabric/client/connection.hpp"
#include "common/fabric/client/endorsement_collector.hpp"
#include "common/fabric/client/ordering.hpp"
#include "gateway/gateway.grpc.pb.h"
#include "peer/peer.grpc.pb.h"

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
/// With orderers in the config the call goes the direct path: ProcessProposal at the peer in place of Endorse,
/// Broadcast in place of Submit; where no orderer is reached, the gateway's Submit after all. A call that needs two
/// organisations asks its endorsers' peers side by side (Gathering); of an organisation whose peers the config does not
/// name the gateway finds one.
class Pipeline {
 public:
  explicit Pipeline(std::shared_ptr<const Connection> connection);
  /// Ends what is in flight as unavailable.
  ~Pipeline();
  void submit(Call call, std::function<void(Outcome)> done);

 private:
  using Time = std::chrono::system_clock::time_point;
  static constexpr std::chrono::milliseconds rest{200};
  template <typename Response>
  struct Unary {
    grpc::ClientContext context;
    Response response;
    grpc::Status status;
    std::unique_ptr<grpc::ClientAsyncResponseReader<Response>> reader;
  };
  enum class Stage { endorsing, ready, sent, acknowledged, finished };
  struct Pending {
    std::uint64_t number = 0;
    Call call;
    std::function<void(Outcome)> done;
    Time deadline;
    Stage stage = Stage::endorsing;
    std::shared_ptr<const crypto::SigningIdentity> self;  ///< whom it is signed as, all of it
    Proposal proposal;
    std::string envelope;  ///< signed
    std::string answer;
    std::string submit_problem;  ///< why it is not known whether Submit arrived
    TimeNs begun_ns = 0, endorsed_ns = 0, ordered_ns = 0;
    bool awaited = false;  ///< a block stream is to report its end
    int attempts = 0;      ///< of the call that may be repeated now
    BackOff back_off{first_retry_ns, max_retry_ns};
    std::shared_ptr<Unary<gateway::EndorseResponse>> endorse;
    std::shared_ptr<Unary<protos::ProposalResponse>> propose;  ///< on the direct path in place of endorse
    std::optional<std::size_t> endorser{};  ///< that `propose` asks (within_: the own one here); none: the own peer
    EndorsementNeed need;
    std::vector<std::shared_ptr<Unary<protos::ProposalResponse>>> asked{};  ///< of several organisations
    std::optional<Gathering> gathering{};
    std::string unheard{};                 ///< Outcome::unheard
    std::optional<std::size_t> orderer{};  ///< that it was sent to, and no other
    TimeNs sent_ns = 0;
    std::shared_ptr<Unary<gateway::SubmitResponse>> submit;
    std::shared_ptr<Unary<gateway::CommitStatusResponse>> status;
    std::shared_ptr<grpc::Alarm> alarm;
  };
  using PendingPtr = std::shared_ptr<Pending>;
  using Tag = std::function<void(bool ok)>;
  struct Job {
    Call call;
    std::function<void(Outcome)> done;
    Time deadline;
  };

  void run();
  /// Has the thread look at the inbox. With mutex_ held.
  void wake();
  void take_inbox();
  void take_commits();
  /// Uses the connections that exist now; calls in flight end over the old ones.
  void take_channels();
  void begin(Job job);
  void endorse(const PendingPtr& p);
  void propose_to(const PendingPtr& p, protos::Endorser::Stub& endorser);
  /// Asks the endorser in this process. False: there is none, or it rests.
  bool propose_within(const PendingPtr& p);
  /// The same where several organisations are asked: whether it has answered.
  bool gather_within(const PendingPtr& p, const std::string& organisation);
  /// False: the config does not name enough endorsers.
  bool gather(const PendingPtr& p);
  void on_gathered(const PendingPtr& p, bool late);
  void on_endorsed(const PendingPtr& p);
  void on_proposed(const PendingPtr& p);
  void on_not_endorsed(const PendingPtr& p, const grpc::Status& status);
  /// Of its organisation another endorser, or the peer, is asked for a while: it does not answer, or is behind.
  void let_rest(std::size_t endorser, std::chrono::milliseconds time = rest);
  /// Whether the config names one more of its organisation behind it.
  bool has_another(std::size_t endorser) const;
  std::vector<std::size_t> endorsers_now() const;
  void take_endorsed(const PendingPtr& p, const Result<std::string>& unsigned_envelope);
  void send_next();
  void send(const PendingPtr& p);
  void submit_through_gateway(const PendingPtr& p);
  void on_submitted(const PendingPtr& p);
  void on_ordered(const PendingPtr& p, Ordering::Ended ended, const std::string& why);
  void await_commit(const PendingPtr& p);
  void ask_status(const PendingPtr& p);
  void on_status(const PendingPtr& p);
  static void acknowledged(const PendingPtr& p);
  bool retry(const PendingPtr& p, const grpc::Status& status, void (Pipeline::*again)(const PendingPtr&));
  void finish(const PendingPtr& p, Outcome::Kind kind, const std::string& message);
  void finish(const PendingPtr& p, Outcome outcome);
  void end_all();
  template <typename Response>
  std::shared_ptr<Unary<Response>> make_unary(const PendingPtr& p) const;
  template <typename Response>
  void await(const PendingPtr& p, const std::shared_ptr<Unary<Response>>& unary,
             void (Pipeline::*then)(const PendingPtr&));

  const std::shared_ptr<const Connection> connection_;
  std::shared_ptr<const GrpcChannels> channels_;                    ///< that those below are of
  std::vector<std::unique_ptr<gateway::Gateway::Stub>> gateways_;   ///< of each peer
  std::vector<std::unique_ptr<protos::Endorser::Stub>> proposals_;  ///< likewise
  std::vector<std::unique_ptr<protos::Endorser::Stub>> endorsers_;  ///< of each endorser
  std::vector<Time> rest_until_;  ///< of each endorser, then of the one in this process
  const std::size_t within_;      ///< its index there
  grpc::CompletionQueue queue_;

  std::mutex mutex_;  ///< guards the three below, and that nothing is put into the queue after its shutdown
  std::vector<Job> inbox_;
  bool woken_ = false;
  bool stopping_ = false;

  // The thread's own.
  std::uint64_t next_number_ = 0;
  std::map<std::uint64_t, PendingPtr> live_;
  Random random_{random_seed()};
  std::deque<PendingPtr> order_;      ///< not yet acknowledged, oldest first
  std::optional<Ordering> ordering_;  ///< on the direct path
  std::thread thread_;
};

template <typename Response>
std::shared_ptr<Pipeline::Unary<Response>> Pipeline::make_unary(const PendingPtr& p) const {
  auto unary = std::make_shared<Unary<Response>>();
  unary->context.set_deadline(p->deadline);
  return unary;
}

template <typename Response>
void Pipeline::await(const PendingPtr& p, const std::shared_ptr<Unary<Response>>& unary,
                     void (Pipeline::*then)(const PendingPtr&)) {
  // The tag keeps the call alive until gRPC is done with it, also when it was finished before.
  unary->reader->Finish(&unary->response, &unary->status, new Tag([this, p, unary, then](bool) {
    if (p->stage != Stage::finished) (this->*then)(p);
  }));
}

}  // namespace ledgerline::fabric
