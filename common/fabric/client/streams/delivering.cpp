#include "common/fabric/client/streams/delivering.hpp"

#include <fmt/format.h>

#include <chrono>

#include "peer/events.grpc.pb.h"

namespace ledgerline::fabric {

std::string text_of(const grpc::Status& status) {
  return status.ok() ? "the ledger ended the stream"
                     : fmt::format("{} (gRPC {})", describe(status), static_cast<int>(status.error_code()));
}

Result<common::Block> fetch_block(const Connection& connection, Follower& follower,
                                  std::optional<std::uint64_t> number) {
  grpc::ClientContext context;
  const Follower::Cancellable cancellable(follower, context);
  context.set_deadline(std::chrono::system_clock::now() + connection.config.deadline);
  const std::size_t peer = connection.peer();
  const auto channels = connection.channels();
  const auto stub = protos::Deliver::NewStub(channels->stream_peers[peer]);
  const auto stream = stub->Deliver(&context);
  if (std::string problem = seek(connection, *stream, channels->peer_tls_hashes[peer], number, SeekStop::at_start);
      !problem.empty())
    return Error{problem};
  protos::DeliverResponse response;
  const bool read = stream->Read(&response);
  context.TryCancel();
  const grpc::Status status = stream->Finish();
  if (!read || response.Type_case() != protos::DeliverResponse::kBlock ||
      (number && response.block().header().number() != *number))
    return Error{fmt::format("the peer does not give {}: {}",
                             number ? fmt::format("block {}", *number) : "its newest block", text_of(status))};
  return std::move(*response.mutable_block());
}

}  // namespace ledgerline::fabric
