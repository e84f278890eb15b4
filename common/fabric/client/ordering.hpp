#pragma once
#include <grpcpp/alarm.h>

#include <functional>
#include <memory>
#include <vector>

#include "common/fabric/client/connection.hpp"
#include "common/fabric/client/orderer_choice.hpp"
#include "orderer/ab.grpc.pb.h"

namespace ledgerline::fabric {

/// One long-lived Broadcast stream to the orderer that orders soonest (OrdererChoice), and to those that were probed;
/// when it breaks, to the next. Lives on the completion queue and the thread of a Pipeline; its tags are
/// std::function<void(bool)>*, as the pipeline's.
///
///     send() -> connecting -> writing -> waiting for the acknowledgement -> done
///                  ^             |  broken, silent, no leader: the next orderer, after a back-off
///                  +-------------+
///
/// An envelope may be sent twice when an acknowledgement was lost; the ledger takes a transaction once.
class Ordering {
 public:
  enum class Ended {
    acknowledged,  ///< it will be in a block
    refused,       ///< by the orderer: the text says why
    open,          ///< it was sent, and no more is known
    not_sent,      ///< no orderer was reached
  };
  using Done = std::function<void(Ended ended, const std::string& why)>;

  Ordering(std::vector<std::shared_ptr<grpc::Channel>> orderers, grpc::CompletionQueue& queue);

  /// One at a time (busy). `done` comes once, by the deadline, never within the call. `may_probe`:
  /// it may be 0.1 s late, and no envelope of ours that was sent before is on its way to a block.
  void send(std::string_view envelope, bool may_probe, std::chrono::system_clock::time_point deadline, Done done);
  bool busy() const { return done_ != nullptr; }
  /// Where the newest envelope went last.
  std::size_t which() const { return which_; }
  /// An envelope that went to this orderer alone was seen in a block.
  void on_committed(std::size_t orderer, TimeNs took_ns) { choice_.on_committed(orderer, took_ns, monotonic_ns()); }
  /// The same orderers over new connections, from the next envelope on.
  void renew(std::vector<std::shared_ptr<grpc::Channel>> orderers);
  /// Cancels the stream; what is in flight reports no outcome any more. Before the queue's shutdown.
  void end();

 private:
  using Tag = std::function<void(bool ok)>;
  struct Stream {
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientAsyncReaderWriter<common::Envelope, orderer::BroadcastResponse>> io;
    orderer::BroadcastResponse response;
  };

  void connect();
  void write();
  void on_acknowledged(bool ok);
  void try_next(const std::string& why);
  void drop_stream();
  void cancel_streams();
  void pass_on();
  void finish(Ended ended, const std::string& why);
  /// A tag that counts only while the same send is in flight on the same stream.
  Tag* tag(std::function<void(bool ok)> then);

  std::vector<std::shared_ptr<grpc::Channel>> orderers_, renewed_;  ///< the second: for the next envelope; empty: none
  grpc::CompletionQueue& queue_;
  OrdererChoice choice_;
  std::size_t which_ = 0;
  std::vector<std::shared_ptr<Stream>> streams_;  ///< of each orderer; none: it has to be opened
  std::shared_ptr<Stream> stream_;                ///< that of `which_`
  std::shared_ptr<grpc::Alarm> pause_, limit_, silence_;
  BackOff back_off_;
  Random random_{random_seed()};

  // Of the send that is in flight.
  std::uint64_t number_ = 0;
  common::Envelope envelope_;
  std::chrono::system_clock::time_point deadline_;
  Done done_;
  bool sent_ = false, ended_ = false;
};

}  // namespace ledgerline::fabric
