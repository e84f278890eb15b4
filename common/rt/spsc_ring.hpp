#pragma once
#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <type_traits>

namespace ledgerline {

/// Wait-free queue from one producer thread to one consumer thread, of fixed capacity (a power of two).
/// A full ring refuses the new element; the producer counts or merges, by its own rule. No heap, no lock, no system
/// call. Indices only grow; an element's place is index modulo capacity, so full and empty are distinguished without a
/// spare slot. Each side keeps the other's index as it last saw it, and looks again only when that one says full or
/// empty: so the two threads share a cache line only when they must.
template <typename T, std::size_t Capacity>
class SpscRing {
  static_assert((Capacity & (Capacity - 1)) == 0, "capacity is a power of two");
  static_assert(std::is_trivially_copyable_v<T>, "elements cross threads as plain data");

 public:
  /// Producer thread only. False when full: nothing is stored, though the consumer may be making room just now.
  bool push(const T& element) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_seen_ == Capacity) {
      head_seen_ = head_.load(std::memory_order_acquire);
      if (tail - head_seen_ == Capacity) return false;
    }
    slots_[tail % Capacity] = element;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  /// Consumer thread only. False when empty: `out` is untouched, though the producer may be storing one just now.
  bool pop(T& out) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_seen_) {
      tail_seen_ = tail_.load(std::memory_order_acquire);
      if (head == tail_seen_) return false;
    }
    out = slots_[head % Capacity];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

  /// Any thread; stale by the time it is read, and never more than the capacity.
  std::size_t size() const noexcept {
    const std::size_t head = head_.load(std::memory_order_acquire);
    return std::min(tail_.load(std::memory_order_acquire) - head, Capacity);
  }

 private:
  alignas(64) std::atomic<std::size_t> head_{0};
  std::size_t tail_seen_ = 0;  ///< the consumer's
  alignas(64) std::atomic<std::size_t> tail_{0};
  std::size_t head_seen_ = 0;  ///< the producer's
  alignas(64) std::array<T, Capacity> slots_{};
};

}  // namespace ledgerline
