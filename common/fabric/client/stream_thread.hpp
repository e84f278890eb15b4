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
class StreamThread final : public Client::Stream {
 public:
  using OnConnection = std::function<void(bool, const std::string&)>;
  /// `follow` makes one connection, hands over what comes, and returns why it ended.
  StreamThread(std::function<std::string(StreamThread&)> follow, OnConnection on_connection);
  ~StreamThread() override;
  /// Ends it; the destructor waits for its thread.
  void stop();
  /// The call in progress is cancelled, as if the stream had ended. Any thread.
  void interrupt();

  // For `follow`, on its thread.

  /// The call may be cancelled from outside while this object lives.
  class Cancellable {
   public:
    Cancellable(StreamThread& thread, grpc::ClientContext& context);
    ~Cancellable();
    Cancellable(const Cancellable&) = delete;
    Cancellable& operator=(const Cancellable&) = delete;

   private:
    StreamThread& follower_;
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

  const std::function<std::string(StreamThread&)> follow_;
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

/// A thread of what `reader->follow(StreamThread&)` reads.
template <typename Reader>
std::unique_ptr<StreamThread> run_reader(std::shared_ptr<Reader> reader, StreamThread::OnConnection on_connection) {
  return std::make_unique<StreamThread>([reader](StreamThread& thread) { return reader->follow(thread); },
                                        std::move(on_connection));
}

// What readers share.

/// Why a stream of the server at `endpoint` ended.
std::string text_of(const grpc::Status& status, const std::string& endpoint);

/// Reads until the stream of `endpoint` ends, or `on_message` has an error: why it ended. The thread's call is
/// `context`.
template <typename Stream, typename Message, typename OnMessage>
std::string read_all(StreamThread& thread, grpc::ClientContext& context, Stream& stream, const std::string& endpoint,
                     Message& message, const OnMessage& on_message) {
  while (stream.Read(&message)) {
    const Status handled = on_message(message);
    if (handled && !thread.stopping()) continue;
    context.TryCancel();
    (void)stream.Finish();
    return handled ? std::string() : handled.error().message;
  }
  return text_of(stream.Finish(), endpoint);
}

/// Requests blocks from `start` on. `endpoint`, `tls_hash`: of the server.
template <typename DeliverStream>
Status seek(const Connection& connection, DeliverStream& stream, const std::string& endpoint,
            const std::string& tls_hash, std::optional<std::uint64_t> start, SeekStop stop = SeekStop::never) {
  auto envelope = make_seek(*connection.signing(), connection.config.where.channel, start, realtime_ns(),
                            crypto::random_bytes(24), stop, tls_hash);
  if (!envelope) return envelope.error();
  common::Envelope message;
  message.ParseFromString(*envelope);
  return stream.Write(message) ? Status(done) : Error{text_of(stream.Finish(), endpoint)};
}

/// One block of the peer that is asked now, while another stream waits; without a number its newest.
Result<common::Block> fetch_block(const Connection& connection, StreamThread& thread,
                                  std::optional<std::uint64_t> number);

/// Begins at number `start`, behind a checkpoint, or, where both are missing, with the next new block.
std::unique_ptr<Client::Stream> open_block_stream(const std::shared_ptr<const Connection>& connection,
                                                  std::optional<std::uint64_t> start,
                                                  std::optional<LastVerified> verified,
                                                  Client::StreamHandlers handlers);
std::unique_ptr<Client::Stream> open_event_stream(std::shared_ptr<const Connection> connection,
                                                  std::optional<std::uint64_t> start, std::string after_tx_id,
                                                  std::function<void(const Client::Event&)> on_event,
                                                  StreamThread::OnConnection on_connection);

}  // namespace ledgerline::fabric
