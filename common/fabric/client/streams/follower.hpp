#pragma once
#include <grpcpp/grpcpp.h>

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

#include "common/base/random.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/client/connection.hpp"
#include "common/rt/retry/back_off.hpp"

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

}  // namespace ledgerline::fabric
