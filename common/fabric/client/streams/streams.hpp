#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "common/fabric/client/connection.hpp"
#include "common/fabric/client/streams/follower.hpp"

namespace ledgerline::fabric {

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
