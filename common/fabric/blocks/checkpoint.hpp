#pragma once
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "common/base/result.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/rt/clock.hpp"

namespace common {
class Block;
}

namespace ledgerline::fabric {

/// The newest block that a program has verified, so that a peer cannot show it another chain, or an older one, when it
/// starts again.
struct Checkpoint {
  std::string channel;
  std::uint64_t number = 0;
  std::string hash;     ///< of the block's header, as ChainCheck has it
  std::string records;  ///< what the program itself verified behind that block; any bytes
};

/// As it is in a file: lines, the records, and a SHA-256 of all of it, which detects a torn or overwritten file. It is
/// no protection against a writer of the file, who can write the right sum.
std::string to_text(const Checkpoint& checkpoint);
/// An error: it is not whole, or of another kind.
Result<Checkpoint> checkpoint_from(std::string_view text);

/// None where there is no file, or no path. A damaged file, or one of another channel, is an error that says what to
/// do: never silently a start without one.
Result<std::optional<Checkpoint>> read_checkpoint(const std::string& path, const std::string& channel);
/// With mode 0600, whole or not at all, on the disk when it returns.
Status write_checkpoint(const std::string& path, const Checkpoint& checkpoint);

/// What a program that starts again knows of the chain.
struct LastVerified {
  Checkpoint last;
  /// So many blocks behind it are read one by one, so that nothing on them is missed; more are left out.
  std::uint64_t max_absence_blocks = 0;
};

/// How a peer's chain goes on behind what was verified.
struct Continuation {
  ChainCheck chain;  ///< its height() is the first block to read
  std::uint64_t verified = 0, newest = 0;
  /// The blocks between them are not read: only the newest one's own signatures say that it is of this chain.
  bool gap = false;
};

/// Whether the peer's chain, whose newest block has that header, can be the one that was verified. Refused, in words:
/// it ends before the checkpoint, or has another block in its place (a fork). Fetches at most the checkpoint's block.
/// Pure.
Result<Continuation> continue_behind(const LastVerified& verified, const common::Block& newest,
                                     const std::function<Result<common::Block>(std::uint64_t number)>& fetch);

/// Writes the newest checkpoint into its file on a thread of its own, so that nobody who takes blocks waits for a disk.
/// Destruction writes what is newest and joins. One program a file.
class CheckpointWriter {
 public:
  /// What is lost to a kill: so many blocks are read once more. A card in a companion computer is written to so often.
  static constexpr TimeNs usual_period_ns = 1 * ns_per_s;

  /// `on_problem`: why the file is not written; once until it is again. On its own thread.
  CheckpointWriter(std::string path, std::function<void(const std::string&)> on_problem,
                   TimeNs period_ns = usual_period_ns);
  ~CheckpointWriter();
  CheckpointWriter(const CheckpointWriter&) = delete;
  CheckpointWriter& operator=(const CheckpointWriter&) = delete;

  /// Any thread; never waits for the disk. Of several within a period the last one is written.
  void store(Checkpoint newest);

 private:
  void run();
  void write(const Checkpoint& checkpoint);

  const std::string path_;
  const std::function<void(const std::string&)> on_problem_;
  const TimeNs period_ns_;
  bool problem_reported_ = false;
  std::mutex mutex_;
  std::condition_variable wake_, end_;  ///< the second cuts a period short; store() wakes nobody within one
  std::optional<Checkpoint> newest_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace ledgerline::fabric
