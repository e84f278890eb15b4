#pragma once
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <array>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <utility>

#include "common/rt/clock.hpp"

namespace ledgerline {

/// From any threads to one loop, which the box's file descriptor wakes at once. Bounded: whoever brings a letter by
/// put_in_turn() into a full box waits, so a stream slows down instead of memory growing; put() never waits and may
/// come from the loop itself: for letters of which only few can exist.
template <typename Letter>
class Mailbox {
 public:
  explicit Mailbox(std::size_t max_in_turn = 256)
      : max_in_turn_(max_in_turn), wake_fd_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}
  ~Mailbox() { ::close(wake_fd_); }
  Mailbox(const Mailbox&) = delete;
  Mailbox& operator=(const Mailbox&) = delete;

  /// Any thread but the loop's. Returns at once after close(): the letter is then thrown away.
  void put_in_turn(Letter letter) {
    {
      std::unique_lock lock(mutex_);
      room_.wait(lock, [&] { return closed_ || in_turn_ < max_in_turn_; });
      if (closed_) return;
      ++in_turn_;
      letters_.push_back(std::move(letter));
    }
    wake();
  }

  /// Any thread.
  void put(Letter letter) {
    {
      const std::lock_guard lock(mutex_);
      if (closed_) return;
      letters_.push_back(std::move(letter));
    }
    wake();
  }

  /// Any thread: wakes the loop without a letter.
  void wake() {
    const std::uint64_t one = 1;
    (void)!::write(wake_fd_, &one, sizeof one);  // fails only when 2^64 - 2 wakes wait already
  }

  /// The loop only: until something has come, or `other_fd` is readable, for so long at most, or a signal comes.
  void wait(TimeNs timeout_ns, int other_fd = -1) const {
    std::array<pollfd, 2> fds{pollfd{.fd = wake_fd_, .events = POLLIN, .revents = 0},
                              pollfd{.fd = other_fd, .events = POLLIN, .revents = 0}};  // below 0: none
    const timespec timeout{.tv_sec = timeout_ns / ns_per_s, .tv_nsec = timeout_ns % ns_per_s};
    (void)::ppoll(fds.data(), fds.size(), &timeout, nullptr);  // interrupted or not: the loop looks at everything
  }

  /// The loop only: all that has come, in order. Also clears the descriptor.
  std::deque<Letter> take_all() {
    std::uint64_t count = 0;
    (void)!::read(wake_fd_, &count, sizeof count);  // nothing to read: nothing has come
    std::deque<Letter> letters;
    {
      const std::lock_guard lock(mutex_);
      letters.swap(letters_);
      in_turn_ = 0;
    }
    room_.notify_all();
    return letters;
  }

  /// Readable while there is something to take.
  int wake_fd() const { return wake_fd_; }

  /// Lets everybody go who waits; from now on letters are thrown away.
  void close() {
    {
      const std::lock_guard lock(mutex_);
      closed_ = true;
    }
    room_.notify_all();
  }

 private:
  const std::size_t max_in_turn_;
  const int wake_fd_;
  std::mutex mutex_;
  std::condition_variable room_;
  std::deque<Letter> letters_;
  std::size_t in_turn_ = 0;
  bool closed_ = false;
};

}  // namespace ledgerline
