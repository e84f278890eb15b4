#pragma once
#include <pthread.h>

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace ledgerline {

/// A fixed number of threads and a bounded queue before them. All methods from any thread, but for the tasks' own.
class Workers {
 public:
  /// `role`: the threads' name, at most 15 characters.
  Workers(const char* role, int threads, std::size_t max_waiting = 1000) : role_(role), max_waiting_(max_waiting) {
    for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { run(); });
  }
  ~Workers() { close(); }
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  enum class Waiting { finished, dropped };
  /// Nothing is taken from here on; waits until all that was is done, or what has begun. Once, and again to no effect.
  void close(Waiting waiting = Waiting::finished) {
    std::vector<std::thread> ending;
    std::deque<std::function<void()>> dropped;  // what they hold ends outside of the lock
    {
      const std::lock_guard lock(mutex_);
      over_ = true;
      if (waiting == Waiting::dropped) dropped.swap(tasks_);
      ending.swap(threads_);
    }
    dropped.clear();
    changed_.notify_all();
    for (std::thread& thread : ending) thread.join();
  }

  /// False: too many wait already, or it is closed.
  bool post(std::function<void()> task) {
    {
      const std::lock_guard lock(mutex_);
      if (over_ || tasks_.size() >= max_waiting_) return false;
      tasks_.push_back(std::move(task));
    }
    changed_.notify_one();
    return true;
  }

 private:
  void run() {
    ::pthread_setname_np(::pthread_self(), role_);
    std::unique_lock lock(mutex_);
    for (;;) {
      changed_.wait(lock, [&] { return over_ || !tasks_.empty(); });
      if (tasks_.empty()) return;
      const auto task = std::move(tasks_.front());
      tasks_.pop_front();
      lock.unlock();
      task();
      lock.lock();
    }
  }

  const char* const role_;
  const std::size_t max_waiting_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> tasks_;
  bool over_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace ledgerline
