#pragma once
#include <atomic>
#include <mutex>

namespace ledgerline::endorser {

/// A mutex with a lane for those who must not wait in a crowd. Of the crowd one at most waits for the mutex while
/// another one has it, and none begins to wait while somebody of the first lane does: so who comes by the first lane
/// waits for two of the crowd, however many there are. Any thread.
class PriorityMutex {
 public:
  std::unique_lock<std::mutex> lock_first() {
    ++priority_waiters_;
    std::unique_lock lock(mutex_);
    --priority_waiters_;
    priority_waiters_.notify_all();
    return lock;
  }
  std::unique_lock<std::mutex> lock_later() {
    const std::lock_guard turn(turn_);
    for (int hurried = priority_waiters_; hurried > 0; hurried = priority_waiters_) priority_waiters_.wait(hurried);
    return std::unique_lock(mutex_);
  }

 private:
  std::mutex mutex_, turn_;               ///< the second: of the crowd, until it has the first
  std::atomic<int> priority_waiters_{0};  ///< wait by the first lane
};

}  // namespace ledgerline::endorser
