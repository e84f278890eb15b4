#pragma once
#include <array>
#include <atomic>
#include <cstddef>
#include <type_traits>

namespace ledgerline {

/// Wait-free queue from one producer thread to one consumer thread, of fixed capacity (a power of two).
/// A full ring refuses the new element; the producer counts or merges, by its own rule. No heap, no system call.
/// Indices only grow; an element's place is index modulo capacity, so full and empty are told apart without a spare
/// slot.
template <typename T, std::size_t Capacity>
class SpscRing {
  static_assert((Capacity & (Capacity - 1)) == 0, "capacity is a power of two");
  static_assert(std::is_trivially_copyable_v<T>, "elements cross threads as plain data");

 public:
  /// Producer thread only. False when full: nothing is stored.
  bool push(const T& element) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_.load(std::memory_order_acquire) == Capacity) return false;
    slots_[tail % Capacity] = element;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  /// Consumer thread only.
  bool pop(T& out) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_.load(std::memory_order_acquire)) return false;
    out = slots_[head % Capacity];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

  /// Any thread; stale by the time it is read.
  std::size_t size() const noexcept {
    const std::size_t head = head_.load(std::memory_order_acquire);
    return tail_.load(std::memory_order_acquire) - head;
  }

 private:
  alignas(64) std::atomic<std::size_t> head_{0};
  alignas(64) std::atomic<std::size_t> tail_{0};
  alignas(64) std::array<T, Capacity> slots_{};
};

}  // namespace ledgerline
