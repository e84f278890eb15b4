#pragma once
#include "common/base/result.hpp"
#include "onboard/roudi/leak_watch.hpp"

namespace iox::mepoo {
class MemoryManager;
}

namespace ledgerline::roudi {

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
