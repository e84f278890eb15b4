#pragma once
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "chaincode/node/storage/files.hpp"

namespace ledgerline::node {

/// The chain on disk: one file, only ever appended to. It begins with "LLF1" | random salt, 16 bytes | check, 8; then
/// come records:
///
///     "LLB1" | length, 4 bytes LE | header check, 8 | content check, 8 | content
///
/// where a check is the first 8 bytes of a SHA-256 (header check: over salt, magic, length and content check). A record
/// counts once it is synced, and the next one is begun only then; so a crash can leave at most the last record
/// unfinished. That one is cut off at the next open, with a message. Damage with whole records behind it is no crash:
/// opening fails and says where. The salt is never disclosed: what looks like a record inside a member's transaction is
/// none.
///
/// append from one thread at a time; read and height from any.
class BlockStore {
 public:
  /// Hands over each block in order. `message`: what a person should know (a torn tail was cut off).
  using OnBlock = std::function<Status(std::string_view block)>;
  using OnMessage = std::function<void(const std::string& message)>;
  static Result<std::unique_ptr<BlockStore>> open(Files& files, const OnBlock& on_block, const OnMessage& on_message);

  /// Returns when the block is on disk. After an error the store takes no more, what is on disk is not known; but where
  /// full() says so, nothing of the block is left there, and it may be tried again.
  Status append(std::string_view block);
  bool full() const { return full_; }
  Result<std::string> read(std::uint64_t number) const;
  std::uint64_t height() const;

 private:
  struct Extent {
    std::uint64_t offset;
    std::size_t size;
  };
  BlockStore(std::unique_ptr<File> file, std::string name) : file_(std::move(file)), name_(std::move(name)) {}
  Status load(const OnBlock& on_block, const OnMessage& on_message);
  Status open_head(std::uint64_t size, const OnMessage& on_message);
  Result<bool> record_behind(std::uint64_t offset, std::uint64_t end) const;

  std::unique_ptr<File> file_;
  std::string name_;
  std::string salt_;
  std::uint64_t end_ = 0;
  bool broken_ = false, full_ = false;
  mutable std::mutex mutex_;  // guards extents_
  std::vector<Extent> extents_;
};

}  // namespace ledgerline::node
