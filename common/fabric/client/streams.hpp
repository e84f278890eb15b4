#pragma once
#include <condition_variable>
#include <mutex>
#include <thread>

#include "common/fabric/client/connection.hpp"

namespace ledgerline::fabric {

/// Runs one kind of stream on a thread of its own, again and again with back-off and jitter, until it is destroyed. The
/// thread reads with gRPC's blocking calls, which wake it directly; destruction cancels the call that it waits in.
class Follower final : public Client::Stream {
 public:
  using OnConnection = std::function<void(bool, const std::string&)>;
  /// `follow` makes one connection, hands over what comes, and returns why it ended.
  Follower(std::function<std::string(Follower&)> follow, OnConnection on_connection);
  ~Follower() override;

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
  grpc::ClientContext* context_ = nullptr;  ///< of the call under way
  std::thread thread_;
};

/// Where a stream of blocks begins: at a number, behind a checkpoint, or, where both are missing, with the next new one.
struct BlocksFrom {
  std::optional<std::uint64_t> number;
  std::optional<Believed> believed;
};
std::unique_ptr<Client::Stream> follow_blocks(std::shared_ptr<const Connection> connection, BlocksFrom from,
                                              Client::StreamHandlers handlers);
std::unique_ptr<Client::Stream> follow_events(std::shared_ptr<const Connection> connection,
                                              std::optional<std::uint64_t> start, std::string after_tx_id,
                                              std::function<void(const Client::Event&)> on_event,
                                              Follower::OnConnection on_connection);

}  // namespace ledgerline::fabric
