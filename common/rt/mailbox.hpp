#pragma once
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <utility>

#include "common/rt/clock.hpp"

namespace ledgerline {

/// From any threads to one loop, which the box's file descriptor wakes at once; events come out in the order in which
/// they were put. Nobody takes a lock, so no thread that is put aside in here holds up another: the loop's take is one
/// exchange, wait-free, and a put tries again only if another came in between. (The heap, where events lie, is
/// shared.)
///
/// Bounded: a caller of put_in_turn() waits while the box is full, so a stream slows down instead of memory
/// growing; put() never waits and may come from the loop itself: for events of which only few can exist.
template <typename Event>
class Mailbox {
 public:
  explicit Mailbox(std::uint32_t max_in_turn = 256)
      : max_in_turn_(max_in_turn), wake_fd_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}
  /// Nobody puts any more.
  ~Mailbox() {
    (void)pop_all();
    ::close(wake_fd_);
  }
  Mailbox(const Mailbox&) = delete;
  Mailbox& operator=(const Mailbox&) = delete;

  /// Any thread but the loop's. Returns at once after close(): the event is then thrown away.
  void put_in_turn(Event event) {
    if (wait_for_room()) push(std::make_unique<Node>(Node{std::move(event), true, nullptr}));
  }

  /// Any thread.
  void put(Event event) {
    if ((in_turn_.load() & closed) == 0) push(std::make_unique<Node>(Node{std::move(event), false, nullptr}));
  }

  /// Any thread: wakes the loop without an event.
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

  /// The loop only: all that has come, in order. Clears the descriptor first: who puts behind that wakes behind it.
  std::deque<Event> pop_all() {
    std::uint64_t count = 0;
    (void)!::read(wake_fd_, &count, sizeof count);  // nothing to read: nothing has come
    std::deque<Event> events;
    std::uint32_t in_turn = 0;
    for (Node* newest = newest_.exchange(nullptr, std::memory_order_acquire); newest;) {
      const std::unique_ptr<Node> node(newest);
      newest = node->older;
      in_turn += node->in_turn ? 1 : 0;
      events.push_front(std::move(node->event));
    }
    if (in_turn > 0) {
      in_turn_.fetch_sub(in_turn);
      in_turn_.notify_all();  // a system call only where somebody waits
    }
    return events;
  }

  /// Readable while there is something to take.
  int wake_fd() const { return wake_fd_; }

  /// Lets everybody go who waits; from now on events are thrown away.
  void close() {
    in_turn_.fetch_or(closed);
    in_turn_.notify_all();
  }

 private:
  struct Node {
    Event event;
    bool in_turn = false;
    Node* older = nullptr;
  };
  static constexpr std::uint32_t closed = 1U << 31;

  /// False: the box is closed.
  bool wait_for_room() {
    std::uint32_t seen = in_turn_.load();
    while ((seen & closed) == 0) {
      if (seen >= max_in_turn_) {
        in_turn_.wait(seen);
        seen = in_turn_.load();
      } else if (in_turn_.compare_exchange_weak(seen, seen + 1)) {
        return true;
      }
    }
    return false;
  }

  // The loop takes all or nothing, so a node that is the newest again is never one that was away meanwhile.
  void push(std::unique_ptr<Node> event) {
    Node* const node = event.release();
    node->older = newest_.load(std::memory_order_relaxed);
    while (!newest_.compare_exchange_weak(node->older, node, std::memory_order_release, std::memory_order_relaxed)) {
    }
    wake();
  }

  const std::uint32_t max_in_turn_;
  const int wake_fd_;
  std::atomic<Node*> newest_{nullptr};
  std::atomic<std::uint32_t> in_turn_{0};  ///< events of put_in_turn() that are in here, or come now; and `closed`
};

}  // namespace ledgerline
