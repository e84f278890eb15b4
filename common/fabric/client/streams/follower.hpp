#pragma once
#include <grpcpp/grpcpp.h>

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "common/base/random.hpp"
#include "common/common.pb.h"
#include "common/fabric/client/client.hpp"
#include "common/fabric/client/connection.hpp"
#include "common/rt/retry.hpp"

namespace ledgerline::fabric {

/// Runs one kind of stream on a thread of its own, repeatedly with back-off and jitter, until it is destroyed. The
/// thread reads with gRPC's blocking calls, which wake it directly; destruction cancels the call that it waits in.
class Follower final : public Client::Stream {
 public:
  using OnConnection = std::function<void(bool, const std::string&)>;
  /// `follow` makes one connection, hands over what comes, and returns why it ended.
  Follower(std::function<std::string(Follower&)> follow, OnConnection on_connection);
  ~Follower() override;
  /// Ends it; the destructor waits for its thread.
  void stop();
  /// The call in progress is cancelled, as if the stream had ended. Any thread.
  void interrupt();

  // For `follow`, on its thread.

  /// The call may be cancelled from outside while this object lives.
  class Cancellable {
   public:
    Cancellable(Follower& follower, grpc::ClientContext& context);
    ~Cancellable();
    Cancellable(const Cancellable&) = delete;
    Cancellable& operator=(const Cancellable&) = delete;

   private:
    Follower& follower_;
    grpc::ClientContext* outer_ = nullptr;  ///< of a call that waits while this one is made
  };
  bool stopping();
  /// Waits so long; false: it is to stop.
  bool pause(TimeNs time_ns);
  /// The stream is there; said once a connection.
  void connected();
  /// Something good came: the next back-off starts from its shortest.
  void progress() { back_off_.succeeded(); }

 private:
  void run();

  const std::function<std::string(Follower&)> follow_;
  const OnConnection on_connection_;
  BackOff back_off_;
  Random random_{random_seed()};
  bool connected_ = false;
  std::string last_why_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stopping_ = false;
  grpc::ClientContext* context_ = nullptr;  ///< of the call in progress
  std::thread thread_;
};

/// A follower of what `reader->follow(Follower&)` reads.
template <typename Reader>
std::unique_ptr<Follower> run_follower(std::shared_ptr<Reader> reader, Follower::OnConnection on_connection) {
  return std::make_unique<Follower>([reader](Follower& follower) { return reader->follow(follower); },
                                    std::move(on_connection));
}

// What readers of Deliver streams share.

/// Why a stream ended.
std::string text_of(const grpc::Status& status);

/// Asks for blocks from `start` on; an empty text when the question is on its way. `tls_hash`: of the server that is
/// asked.
template <typename DeliverStream>
std::string seek(const Connection& connection, DeliverStream& stream, const std::string& tls_hash,
                 std::optional<std::uint64_t> start, SeekStop stop = SeekStop::never) {
  auto envelope = make_seek(*connection.signing(), connection.config.where.channel, start, realtime_ns(),
                            crypto::random_bytes(24), stop, tls_hash);
  if (!envelope) return envelope.error().message;
  common::Envelope message;
  message.ParseFromString(*envelope);
  return stream.Write(message) ? "" : text_of(stream.Finish());
}

/// One block of the peer that is asked now, while another stream waits; without a number its newest.
Result<common::Block> fetch_block(const Connection& connection, Follower& follower,
                                  std::optional<std::uint64_t> number);

/// Where a stream of blocks begins: at a number, behind a checkpoint, or, where both are missing, with the next new
/// one.
struct BlocksFrom {
  std::optional<std::uint64_t> number;
  std::optional<LastVerified> verified;
};
std::unique_ptr<Client::Stream> follow_blocks(const std::shared_ptr<const Connection>& connection, BlocksFrom from,
                                              Client::StreamHandlers handlers);
std::unique_ptr<Client::Stream> follow_events(std::shared_ptr<const Connection> connection,
                                              std::optional<std::uint64_t> start, std::string after_tx_id,
                                              std::function<void(const Client::Event&)> on_event,
                                              Follower::OnConnection on_connection);

}  // namespace ledgerline::fabric
