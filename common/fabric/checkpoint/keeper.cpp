#include "common/fabric/checkpoint/keeper.hpp"

#include <chrono>
#include <utility>

namespace ledgerline::fabric {

CheckpointKeeper::CheckpointKeeper(std::string path, std::function<void(const std::string&)> on_problem,
                                   TimeNs period_ns)
    : path_(std::move(path)), on_problem_(std::move(on_problem)), period_ns_(period_ns), thread_([this] { run(); }) {}

CheckpointKeeper::~CheckpointKeeper() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  end_.notify_all();
  thread_.join();
}

void CheckpointKeeper::keep(Checkpoint newest) {
  {
    const std::lock_guard lock(mutex_);
    newest_ = std::move(newest);
  }
  wake_.notify_all();
}

void CheckpointKeeper::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return stopping_ || newest_; });
    if (!newest_) return;  // stopping
    const auto checkpoint = std::exchange(newest_, std::nullopt);
    lock.unlock();
    write(*checkpoint);
    lock.lock();
    end_.wait_for(lock, std::chrono::nanoseconds(period_ns_), [this] { return stopping_; });
  }
}

void CheckpointKeeper::write(const Checkpoint& checkpoint) {
  const Status status = write_checkpoint(path_, checkpoint);
  if (!status && !problem_reported_ && on_problem_) on_problem_(status.error().message);
  problem_reported_ = !status;
}

}  // namespace ledgerline::fabric
