#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "common/base/result.hpp"

namespace iox::mepoo {
class MemoryManager;
}

namespace ledgerline::roudi {

/// Tells chunks that are lost from those in use. A process that was killed may take chunks with it that nobody gives
/// back. Chunks in transit come and go, so what is in use at each of the last looks, beyond what publishers keep while
/// nothing moves, is lost, or waits in the queue of a reader that stands still. Core: one thread.
class LeakWatch {
 public:
  static constexpr std::size_t pools = 3;
  static constexpr std::size_t looks = 10;
  using Chunks = std::array<std::uint32_t, pools>;

  /// `kept`: by the publishers of each pool, one chunk a publisher.
  explicit LeakWatch(const Chunks& kept) : kept_(kept) {}

  void update(const Chunks& used) {
    history_[looks_++ % looks] = used;
    if (looks_ < looks) return;
    leaked_ = 0;
    for (std::size_t pool = 0; pool < pools; ++pool) {
      std::uint32_t least = history_[0][pool];
      for (const Chunks& one : history_) least = std::min(least, one[pool]);
      leaked_ += least - std::min(least, kept_[pool]);
    }
    max_leaked_ = std::max(max_leaked_, leaked_);
  }
  std::uint32_t leaked() const { return leaked_; }
  std::uint32_t max_leaked() const { return max_leaked_; }

 private:
  Chunks kept_;
  std::array<Chunks, looks> history_{};
  std::uint64_t looks_ = 0;
  std::uint32_t leaked_ = 0, max_leaked_ = 0;
};

/// iceoryx' RouDi with small pools, for the processes of one user; one runs per machine. It is never destroyed, since
/// its destructor would run over ports that other processes still use: a process that started one leaves by _exit().
/// Started in one thread, with signals blocked that its own threads shall not see.
class Broker {
 public:
  /// Of the pools: what link's and agent's publishers keep while nothing moves.
  static constexpr LeakWatch::Chunks kept_by_publishers{2, 2, 1};

  /// Once it answers. An error: another one runs, shared memory has no room, or it did not begin to answer. What a
  /// killed one left behind is removed, and not counted against the new one.
  static Result<Broker> start();

  LeakWatch::Chunks chunks_in_use() const;
  /// Memory that others have mapped stays theirs until they end; only the names go, so that nothing is left behind.
  static void remove_names();

 private:
  explicit Broker(iox::mepoo::MemoryManager& memory) : memory_(&memory) {}
  iox::mepoo::MemoryManager* memory_;
};

}  // namespace ledgerline::roudi
