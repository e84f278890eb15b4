#include "tools/audit/source.hpp"

#include <fmt/format.h>

#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>

#include "common/fabric/client/client.hpp"
#include "common/ledger.pb.h"

namespace ledgerline::audit {
namespace {

/// What the stream's thread hands to the audit: a few blocks, so that a peer which is faster fills no memory.
class BlockQueue {
 public:
  /// Waits for room; on the stream's thread.
  void push(std::string_view block) {
    std::unique_lock lock(mutex_);
    room_.wait(lock, [&] { return ended_ || blocks_.size() < max_blocks; });
    if (ended_) return;
    why_.clear();
    blocks_.emplace_back(block);
    filled_.notify_one();
  }
  std::optional<std::string> pop(std::chrono::milliseconds timeout) {
    std::unique_lock lock(mutex_);
    if (!filled_.wait_for(lock, timeout, [&] { return !blocks_.empty(); })) return std::nullopt;
    std::string block = std::move(blocks_.front());
    blocks_.pop_front();
    room_.notify_one();
    return block;
  }
  /// Why the stream was broken; it counts until the next block comes.
  void set_why(const std::string& why) {
    const std::lock_guard lock(mutex_);
    why_ = why;
  }
  std::string why() const {
    const std::lock_guard lock(mutex_);
    return why_;
  }
  /// Nobody takes any more: a thread that waits for room continues.
  void end() {
    const std::lock_guard lock(mutex_);
    ended_ = true;
    room_.notify_all();
  }

 private:
  static constexpr std::size_t max_blocks = 16;
  mutable std::mutex mutex_;
  std::condition_variable room_, filled_;
  std::deque<std::string> blocks_;
  std::string why_;
  bool ended_ = false;
};

/// How many blocks the peer has, by its own contract.
Result<std::uint64_t> height_of(fabric::ClientConfig config) {
  config.where.contract = "qscc";
  const std::string channel = config.where.channel;
  auto client = fabric::Client::create(std::move(config));
  if (!client) return client.error();
  const auto answer = (*client)->evaluate({.function = "GetChainInfo", .args = {channel}});
  if (!answer) return Error{"the chain's height: " + answer.error().message};
  common::BlockchainInfo info;
  if (!info.ParseFromString(*answer)) return Error{"the peer's answer of the chain's height cannot be read"};
  return info.height();
}

}  // namespace

Result<Reading> read_blocks(fabric::Client& client, std::uint64_t height, std::chrono::milliseconds timeout,
                            const OnBlock& on_block) {
  BlockQueue queue;
  Reading reading;
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [&](const fabric::Block&, std::string_view raw) { queue.push(raw); };
  handlers.on_connection = [&](bool connected, const std::string& why) {
    if (!connected) queue.set_why(why);
  };
  auto stream = client.blocks(0, std::move(handlers));
  while (reading.blocks < height) {
    const auto block = queue.pop(timeout);
    if (!block) {
      const std::string why = queue.why();
      reading.problem = fmt::format("the peer said that it has {} blocks, and gives no more of them{}{}", height,
                                    why.empty() ? "" : ": ", why);
      break;
    }
    ++reading.blocks;
    on_block(*block);
  }
  queue.end();
  stream.reset();
  if (reading.blocks == 0) return Error{reading.problem};
  return reading;
}

Result<Reading> read_peer(fabric::ClientConfig config, std::chrono::milliseconds timeout, const OnBlock& on_block) {
  config.config_block.clear();
  config.blocks = fabric::BlockSource::peer;
  const auto height = height_of(config);
  if (!height) return height.error();
  auto client = fabric::Client::create(std::move(config));
  if (!client) return client.error();
  return read_blocks(**client, *height, timeout, on_block);
}

}  // namespace ledgerline::audit
