#pragma once
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "common/fabric/checkpoint/checkpoint.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::fabric {

/// Writes the newest checkpoint into its file on a thread of its own, so that nobody who takes blocks waits for a disk.
/// Destruction writes what is newest and joins. One program a file.
class CheckpointKeeper {
 public:
  /// What is lost to a kill: so many blocks are read once more. A card in a companion computer is written to so often.
  static constexpr TimeNs usual_period_ns = 1 * ns_per_s;

  /// `on_problem`: why the file is not written; once until it is again. On the keeper's thread.
  CheckpointKeeper(std::string path, std::function<void(const std::string&)> on_problem,
                   TimeNs period_ns = usual_period_ns);
  ~CheckpointKeeper();
  CheckpointKeeper(const CheckpointKeeper&) = delete;
  CheckpointKeeper& operator=(const CheckpointKeeper&) = delete;

  /// Any thread; never waits for the disk. Of several within a period the last one is written.
  void keep(Checkpoint newest);

 private:
  void run();
  void write(const Checkpoint& checkpoint);

  const std::string path_;
  const std::function<void(const std::string&)> on_problem_;
  const TimeNs period_ns_;
  bool problem_reported_ = false;
  std::mutex mutex_;
  std::condition_variable wake_, end_;  ///< the second cuts a period short; keep() wakes nobody within one
  std::optional<Checkpoint> newest_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace ledgerline::fabric
