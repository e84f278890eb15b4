#pragma once
#include <grpcpp/grpcpp.h>

#include <condition_variable>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>

#include "hil/sitl/ledger/serving_peer.hpp"
#include "peer/events.grpc.pb.h"

namespace ledgerline {

/// The node's Deliver, handed on as it is; but the client with one certain identity is served by hil::ServingPeer,
/// which has the node's blocks, lies with the peer's real key, and has no orderer's.
class LyingBlocks final : public protos::Deliver::Service {
 public:
  struct Setup {
    std::shared_ptr<grpc::Channel> node;
    hil::PeerKeys keys;
    std::string lied_to;  ///< msp.SerializedIdentity
    hil::PeerTampering lie = hil::PeerTampering::none;
    std::uint64_t seed = 1;
  };
  explicit LyingBlocks(Setup setup);
  ~LyingBlocks() override;
  LyingBlocks(const LyingBlocks&) = delete;
  LyingBlocks& operator=(const LyingBlocks&) = delete;

  /// From now on. Any thread.
  void begin();
  /// When it began, how many blocks were served since, how many of them are not the ledger's, and what the peer itself
  /// ordered.
  nlohmann::json reported() const;

  using Stream = grpc::ServerReaderWriter<protos::DeliverResponse, common::Envelope>;
  grpc::Status Deliver(grpc::ServerContext* context, Stream* client) override;

 private:
  grpc::Status hand_on(grpc::ServerContext& context, const common::Envelope& seek, Stream& client);
  grpc::Status serve(grpc::ServerContext& context, const common::Envelope& seek, Stream& client);
  bool send(Stream& client, const common::Block& block);
  void follow();
  void order();
  bool wait();

  const Setup setup_;
  const std::unique_ptr<protos::Deliver::Stub> stub_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<hil::ServingPeer> peer_;  ///< from the channel's first block on
  std::vector<std::string> honest_;       ///< the ledger's blocks, serialized
  TimeNs began_ns_ = 0;
  std::uint64_t served_ = 0, tampered_ = 0, ordered_ = 0;
  bool stopping_ = false;
  grpc::ClientContext following_;
  std::thread follower_, orders_;
};

}  // namespace ledgerline
