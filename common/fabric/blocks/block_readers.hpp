#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "common/fabric/blocks/block_hand_over.hpp"
#include "common/fabric/client/connection.hpp"
#include "common/fabric/client/stream_thread.hpp"
#include "peer/events.pb.h"

namespace ledgerline::fabric {

/// Reads the own peer's blocks, one connection a call of follow(). One thread.
class BlockReader {
 public:
  BlockReader(std::shared_ptr<const Connection> connection, std::optional<LastVerified> verified,
              std::shared_ptr<BlockHandOver> blocks, std::function<void(const Continuation&)> on_continued)
      : connection_(std::move(connection)),
        verified_(std::move(verified)),
        blocks_(std::move(blocks)),
        on_continued_(std::move(on_continued)) {}

  /// Ends the connection to an orderer that lies or withholds blocks; before the first follow().
  void interrupt_ordered_by(std::function<void()> interrupt) { interrupt_ordered_ = std::move(interrupt); }
  std::string follow(Follower& follower);

 private:
  std::string continue_chain(Follower& follower);
  void ask_definition(Follower& follower);
  struct DefinitionAnswer {
    std::optional<std::string> policy{};  ///< the definition's validation_parameter; none: `problem` says why
    std::string problem{};
    bool may_pass = false;  ///< another question may be answered
  };
  DefinitionAnswer definition_of_peer(Follower& follower) const;
  std::string take(const protos::DeliverResponse& response, Follower& follower);

  const std::shared_ptr<const Connection> connection_;
  std::optional<LastVerified> verified_;  ///< until the chain goes on behind it
  const std::shared_ptr<BlockHandOver> blocks_;
  const std::function<void(const Continuation&)> on_continued_;
  std::function<void()> interrupt_ordered_;
  int lagged_ = 0;  ///< connections in a row in which the peer's chain ended before the checkpoint
  bool definition_problem_reported_ = false;
};

/// Reads an orderer's blocks; the next orderer's when one goes away or delivers invalid blocks. One thread.
class OrderedReader {
 public:
  OrderedReader(std::shared_ptr<const Connection> connection, std::shared_ptr<BlockHandOver> blocks)
      : connection_(std::move(connection)), blocks_(std::move(blocks)) {}

  std::string follow(Follower& follower);

 private:
  const std::shared_ptr<const Connection> connection_;
  const std::shared_ptr<BlockHandOver> blocks_;
  std::size_t which_ = 0;
};

}  // namespace ledgerline::fabric
