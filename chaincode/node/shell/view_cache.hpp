#pragma once
#include <grpcpp/support/byte_buffer.h>

#include <deque>
#include <functional>
#include <mutex>
#include <utility>

#include "chaincode/node/shell/block_feed.hpp"

namespace ledgerline::node {

/// The newest blocks as one service shows them: made once, sent to every reader. All methods from any thread.
class ViewCache {
 public:
  using Make = std::function<Result<grpc::ByteBuffer>(std::string_view block)>;
  ViewCache(const BlockFeed& feed, Make make) : feed_(feed), make_(std::move(make)) {}

  Result<grpc::ByteBuffer> read(std::uint64_t number) {
    {
      const std::lock_guard lock(mutex_);
      for (const auto& [known, bytes] : newest_) {
        if (known == number) return bytes;
      }
    }
    const auto block = feed_.read(number);
    if (!block) return block.error();
    auto bytes = make_(**block);
    if (!bytes) return bytes;
    const std::lock_guard lock(mutex_);
    // Old blocks have one reader, who goes on.
    if (number + kept < feed_.height()) return bytes;
    newest_.emplace_front(number, *bytes);
    if (newest_.size() > kept) newest_.pop_back();
    return bytes;
  }

 private:
  static constexpr std::size_t kept = 16;

  const BlockFeed& feed_;
  const Make make_;
  std::mutex mutex_;
  std::deque<std::pair<std::uint64_t, grpc::ByteBuffer>> newest_;
};

}  // namespace ledgerline::node
