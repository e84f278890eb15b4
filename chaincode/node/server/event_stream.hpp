#pragma once
#include <grpcpp/alarm.h>
#include <grpcpp/support/server_callback.h>

#include "chaincode/node/server/streams.hpp"
#include "gateway/gateway.pb.h"

namespace ledgerline::node {

/// gateway.ChaincodeEvents: a message for each block that has events of the contract.
class EventStream final : public ServedStream<EventStream, grpc::ServerWriteReactor<grpc::ByteBuffer>>,
                          public BlockFeed::Waiter {
 public:
  /// `events`: the contract's events, block by block, as view_of makes them. Limit and cache outlive the stream.
  static EventStream* start(Node& node, Limit& limit, ViewCache& events, const grpc::ByteBuffer& request);
  EventStream(Node& node, Limit& limit, ViewCache& events) : ServedStream(limit), node_(node), events_(events) {}
  /// A block's message; empty when it has no event.
  static ViewCache::Make view_of(const std::string& contract, const std::string& after = {});

  void OnWriteDone(bool ok) override;
  void wake() override;

 private:
  void begin(NodeCore& core, const gateway::ChaincodeEventsRequest& request);
  void pump();

  Node& node_;
  ViewCache& events_;
  grpc::Alarm to_grpc_thread_;

  // Guarded by the mutex:
  grpc::ByteBuffer response_;
  std::string after_;
  std::uint64_t next_ = 0;
  bool streaming_ = false, busy_ = false;
};

}  // namespace ledgerline::node
