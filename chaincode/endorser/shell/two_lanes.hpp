#pragma once
#include <atomic>
#include <mutex>

namespace ledgerline::endorser {

/// A mutex with a lane for those who must not wait in a crowd. Of the crowd one at most waits for the mutex while
/// another one has it, and none begins to wait while somebody of the first lane does: so who comes by the first lane
/// waits for two of the crowd, however many there are. Any thread.
class TwoLanes {
 public:
  std::unique_lock<std::mutex> first() {
    ++hurried_;
    std::unique_lock lock(mutex_);
    --hurried_;
    hurried_.notify_all();
    return lock;
  }
  std::unique_lock<std::mutex> later() {
    const std::lock_guard turn(turn_);
    for (int hurried = hurried_; hurried > 0; hurried = hurried_) hurried_.wait(hurried);
    return std::unique_lock(mutex_);
  }

 private:
  std::mutex mutex_, turn_;      ///< the second: of the crowd, until it has the first
  std::atomic<int> hurried_{0};  ///< wait by the first lane
};

}  // namespace ledgerline::endorser
