#pragma once
#include <deque>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "chaincode/node/storage/block_store.hpp"

namespace gateway {
class ChaincodeEventsResponse;
}
namespace orderer {
class DeliverResponse;
}
namespace protos {
class DeliverResponse;
}

namespace ledgerline::node {

/// Committed blocks for any number of readers, each at its own pace. A reader that is slow holds nobody back and costs
/// no memory: it asks for one block after the other, and old ones come from disk. All methods from any thread.
class BlockFeed {
 public:
  explicit BlockFeed(const BlockStore& store) : store_(store) {}

  using Bytes = std::shared_ptr<const std::string>;
  /// How many blocks are committed.
  std::uint64_t height() const;
  Result<Bytes> read(std::uint64_t number) const;

  /// Someone who waits for a block. wake() comes once for each wait, by who calls wake_readers().
  class Waiter {
   public:
    virtual ~Waiter() = default;
    virtual void wake() = 0;
    /// MSP id of who reads; empty: no matter.
    virtual std::string organisation() const { return {}; }
  };
  /// A wake in any case, with the next wake_readers(): for the first look, which may take long.
  void wake_soon(std::weak_ptr<Waiter> waiter);
  /// False: the block is there already, no wake will come.
  bool wait(std::uint64_t number, std::weak_ptr<Waiter> waiter);

  /// After the block with this number is on disk and applied; in order. `writers`: MSP ids of who has sent it, whose
  /// readers come last, since they know what is in it.
  void publish(std::uint64_t number, std::string bytes, std::set<std::string> writers);
  bool has_news() const;
  /// Where there is news. Not while one has the core: readers may take long.
  void wake_readers();
  /// At start: blocks that are on disk already.
  void start_at(std::uint64_t height);

 private:
  static constexpr std::size_t recent_blocks = 64;

  const BlockStore& store_;
  mutable std::mutex mutex_;  // guards what follows
  std::uint64_t height_ = 0;
  std::deque<Bytes> recent_;  // the last of them is block height_ - 1
  std::vector<std::weak_ptr<Waiter>> waiters_;
  std::size_t prune_at_ = 64;  // so many waiters, and it is time to look for those who have gone
  bool news_ = false;
  std::set<std::string> writers_;  // of the last block
};

// A committed block as each service shows it.

Status fill_peer(std::string_view block, protos::DeliverResponse& response);
/// Without payloads of events, as Fabric's filtered blocks.
Status fill_filtered(std::string_view block, protos::DeliverResponse& response);
/// The contract keeps no private data, so there is none beside the block.
Status fill_with_private_data(std::string_view block, protos::DeliverResponse& response);
/// Without the peer's flags.
Status fill_orderer(std::string_view block, orderer::DeliverResponse& response);
/// The contract's events of valid transactions; those up to `after` (a transaction's id) are left out if it is in the
/// block.
Status fill_events(std::string_view block, const std::string& contract, const std::string& after,
                   gateway::ChaincodeEventsResponse& response);

}  // namespace ledgerline::node
