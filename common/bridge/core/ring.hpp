#pragma once
#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace ledgerline::bridge {

/// A queue of at most `capacity` elements. It grows up to that and never shrinks: once it has been full it allocates
/// nothing.
template <typename T>
class Ring {
 public:
  explicit Ring(std::size_t capacity) : capacity_(capacity) {}

  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  bool full() const { return size_ == capacity_; }
  T& front() { return slots_[head_]; }
  const T& front() const { return slots_[head_]; }

  /// Not when it is full.
  void push_back(T value) {
    make_room();
    slots_[(head_ + size_++) % slots_.size()] = std::move(value);
  }
  void push_front(T value) {
    make_room();
    head_ = (head_ + slots_.size() - 1) % slots_.size();
    slots_[head_] = std::move(value);
    ++size_;
  }
  T pop_front() {
    T value = std::move(slots_[head_]);
    head_ = (head_ + 1) % slots_.size();
    --size_;
    return value;
  }

 private:
  void make_room() {
    if (size_ < slots_.size()) return;
    std::vector<T> more(std::min(capacity_, 2 * slots_.size() + 4));
    for (std::size_t i = 0; i < size_; ++i) more[i] = std::move(slots_[(head_ + i) % slots_.size()]);
    slots_ = std::move(more);
    head_ = 0;
  }

  std::size_t capacity_;
  std::vector<T> slots_;
  std::size_t head_ = 0, size_ = 0;
};

}  // namespace ledgerline::bridge
