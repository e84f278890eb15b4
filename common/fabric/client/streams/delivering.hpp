#pragma once
#include <grpcpp/grpcpp.h>

#include <cstdint>
#include <optional>
#include <string>

#include "common/common.pb.h"
#include "common/fabric/client/connection.hpp"
#include "common/fabric/client/streams/follower.hpp"

/// What readers of Deliver streams share. Inside common/fabric/client alone.
namespace ledgerline::fabric {

/// Why a stream ended.
std::string text_of(const grpc::Status& status);

/// Asks for blocks from `start` on; an empty text when the question is on its way. `tls_hash`: of the server that is
/// asked.
template <typename DeliverStream>
std::string seek(const Connection& connection, DeliverStream& stream, const std::string& tls_hash,
                 std::optional<std::uint64_t> start, SeekStop stop = SeekStop::never) {
  auto envelope = make_seek(*connection.signing(), connection.config.where.channel, start, realtime_ns(),
                            crypto::random_bytes(24), stop, tls_hash);
  if (!envelope) return envelope.error().what;
  common::Envelope message;
  message.ParseFromString(*envelope);
  return stream.Write(message) ? "" : text_of(stream.Finish());
}

/// One block of the peer that is asked now, while another stream waits; without a number its newest.
Result<common::Block> fetch_block(const Connection& connection, Follower& follower,
                                  std::optional<std::uint64_t> number);

}  // namespace ledgerline::fabric
