#pragma once
#include <grpcpp/alarm.h>
#include <grpcpp/support/server_callback.h>

#include "chaincode/node/server/streams.hpp"
#include "gateway/gateway.pb.h"

namespace ledgerline::node {

/// gateway.ChaincodeEvents: a message for each block that has events of the contract.
class EventStream final : public grpc::ServerWriteReactor<grpc::ByteBuffer>,
                          public BlockFeed::Waiter,
                          public std::enable_shared_from_this<EventStream> {
 public:
  /// `events`: the contract's events, block by block, as view_of makes them. Limit and cache outlive the stream.
  static EventStream* start(Node& node, Limit& limit, ViewCache& events, const grpc::ByteBuffer& request);
  EventStream(Node& node, Limit& limit, ViewCache& events) : node_(node), place_(limit.take()), events_(events) {}
  /// A block's message; empty when it has no event.
  static ViewCache::Make view_of(const std::string& contract, const std::string& after = {});

  void OnWriteDone(bool ok) override;
  void OnCancel() override { finish(grpc::Status::CANCELLED); }
  void OnDone() override { self_.reset(); }
  void wake() override;

 private:
  void begin(NodeCore& core, const gateway::ChaincodeEventsRequest& request);
  void pump();
  void finish(const grpc::Status& status);
  void finish_locked(const grpc::Status& status);

  Node& node_;
  const Limit::Place place_;
  ViewCache& events_;
  std::shared_ptr<EventStream> self_;  // until gRPC is done with it
  grpc::Alarm to_grpc_thread_;

  std::mutex mutex_;  // guards what follows
  grpc::ByteBuffer response_;
  std::string after_;
  std::uint64_t next_ = 0;
  bool streaming_ = false, busy_ = false, finished_ = false;
};

}  // namespace ledgerline::node
