#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "common/fabric/blocks/block_intake.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/client/connection.hpp"

namespace ledgerline::fabric {

/// `fetch`, which sets `failed` where a block does not come: what was refused for want of it may be right.
inline BlockIntake::Fetch watched(const BlockIntake::Fetch& fetch, bool& failed) {
  return [&](std::uint64_t number) {
    auto block = fetch(number);
    failed = failed || !block;
    return block;
  };
}

/// Where the peer's stream and an orderer's meet: one BlockIntake, and what is handed over of it in order, whichever
/// stream delivered it first. Any thread; on_block, on_confirmed, on_unverified and on_contradiction are called under
/// its mutex, so that none of them comes beside another.
class BlockHandOver {
 public:
  BlockHandOver(BlockIntake intake, std::shared_ptr<Commits> commits, Client::StreamHandlers handlers)
      : intake_(std::move(intake)), commits_(std::move(commits)), handlers_(std::move(handlers)) {}

  using Fetch = BlockIntake::Fetch;

  /// The intake's own functions, under the mutex.
  template <typename Function>
  auto locked(const Function& function) {
    const std::lock_guard lock(mutex_);
    return function(intake_);
  }
  /// An error: how peer and orderers contradict each other. Both streams are then read on, for on_refused alone.
  Status consistent() const;

  // Of the peer's stream. Errors: why it cannot go on.

  /// Its first block is here.
  void peer_connected();
  enum class OrdererStream {
    goes_on,
    ends,  ///< it contradicts the peer or withholds blocks
  };
  Result<OrdererStream> on_peer_block(const common::Block& message, TimeNs now, const Fetch& fetch);

  // Of an orderer's stream.

  std::optional<std::uint64_t> begin_ordered();
  /// The orderer withheld blocks; none: its stream ended for another reason.
  std::optional<std::string> withheld() const;
  Status on_ordered_block(common::Block message, TimeNs now);

  // For what the readers find out themselves.

  void contradicted(const std::string& what) const;
  void report_unverified(const std::string& what) const;

 private:
  void report_contradiction(const std::string& what) const;
  void refuse(const common::Block& message) const;
  void read_on(const common::Block& message, TimeNs now);
  Result<OrdererStream> add(const common::Block& message, TimeNs now, const Fetch& fetch);
  Result<OrdererStream> confirm(const common::Block& message, TimeNs now);
  Status hand_over_ordered(TimeNs now);
  /// True, and withheld_ says which, where the orderer has not sent a block for too long that the peer has.
  bool check_withheld(std::uint64_t number, TimeNs now);
  void hand_over(Block& block, const common::Block& message, TimeNs now);
  void report_unverified(const Block& block);

  mutable std::mutex mutex_;
  BlockIntake intake_;
  bool begun_ = false;
  std::map<std::uint64_t, TimeNs> ordered_at_;  ///< of what is not confirmed yet
  std::optional<TimeNs> missing_since_;         ///< the peer is ahead of the orderer's stream
  bool orderer_connected_ = false;              ///< on this connection
  std::optional<std::string> withheld_;         ///< what this orderer did
  const std::shared_ptr<Commits> commits_;
  const Client::StreamHandlers handlers_;
  std::uint64_t unverified_ = 0;
  TimeNs next_unverified_ns_ = 0;     ///< the next one is reported then
  TimeNs next_contradiction_ns_ = 0;  ///< it is reported once a second while it lasts
};

}  // namespace ledgerline::fabric
