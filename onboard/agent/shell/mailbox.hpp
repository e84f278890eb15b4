#pragma once
#include <sys/eventfd.h>
#include <unistd.h>

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <string>
#include <variant>
#include <vector>

#include "common/fabric/client/client.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::agent {

/// How a submitted frame ended.
struct FrameEnded {
  std::uint64_t frame = 0;
  fabric::Outcome outcome;
};
/// The block stream came up or broke.
struct StreamState {
  bool connected = false;
  std::string why;
};
/// The control records, as read after the first block had come.
struct ControlsRead {
  std::vector<Control> controls;
};
using Letter = std::variant<fabric::Block, FrameEnded, StreamState, ControlsRead>;

/// From the ledger client's threads to the main loop, which its file descriptor wakes at once. Bounded: whoever brings
/// a block into a full box waits, so the stream slows down instead of memory growing; of the other letters only few can
/// exist (one frame in flight), so they never wait and may come from the main loop itself.
class Mailbox {
 public:
  explicit Mailbox(std::size_t max_blocks = 256)
      : max_blocks_(max_blocks), wake_fd_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}
  ~Mailbox() { ::close(wake_fd_); }
  Mailbox(const Mailbox&) = delete;
  Mailbox& operator=(const Mailbox&) = delete;

  /// Any thread but the main loop's. Returns at once after close(): the block is then thrown away.
  void put_block(fabric::Block block) {
    {
      std::unique_lock lock(mutex_);
      room_.wait(lock, [&] { return closed_ || blocks_ < max_blocks_; });
      if (closed_) return;
      ++blocks_;
      letters_.emplace_back(std::move(block));
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

  /// Main loop only: all that has come, in order. Also clears the descriptor.
  std::deque<Letter> take_all() {
    std::uint64_t count = 0;
    (void)!::read(wake_fd_, &count, sizeof count);  // nothing to read: nothing has come
    std::deque<Letter> letters;
    {
      const std::lock_guard lock(mutex_);
      letters.swap(letters_);
      blocks_ = 0;
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
  void wake() {
    const std::uint64_t one = 1;
    (void)!::write(wake_fd_, &one, sizeof one);  // fails only when 2^64 - 2 wakes wait already
  }

  const std::size_t max_blocks_;
  const int wake_fd_;
  std::mutex mutex_;
  std::condition_variable room_;
  std::deque<Letter> letters_;
  std::size_t blocks_ = 0;
  bool closed_ = false;
};

}  // namespace ledgerline::agent
