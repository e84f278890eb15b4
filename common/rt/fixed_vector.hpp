#pragma once
#include <array>
#include <cstddef>

namespace ledgerline {

/// A list of at most `Capacity` plain elements in place, for a real-time step. A full one refuses, and counts that.
template <typename T, std::size_t Capacity>
class FixedVector {
 public:
  bool push(const T& element) noexcept {
    if (size_ == Capacity) {
      ++refused_;
      return false;
    }
    elements_[size_++] = element;
    return true;
  }
  /// Keeps the count of refusals.
  void clear() noexcept { size_ = 0; }
  void erase_front(std::size_t count) noexcept {
    for (std::size_t i = count; i < size_; ++i) elements_[i - count] = elements_[i];
    size_ -= count;
  }
  void pop_back() noexcept { --size_; }
  std::size_t size() const noexcept { return size_; }
  bool empty() const noexcept { return size_ == 0; }
  bool full() const noexcept { return size_ == Capacity; }
  std::size_t refused() const noexcept { return refused_; }
  T& operator[](std::size_t i) noexcept { return elements_[i]; }
  const T& operator[](std::size_t i) const noexcept { return elements_[i]; }
  T* begin() noexcept { return elements_.data(); }
  T* end() noexcept { return elements_.data() + size_; }
  const T* begin() const noexcept { return elements_.data(); }
  const T* end() const noexcept { return elements_.data() + size_; }

 private:
  std::array<T, Capacity> elements_{};
  std::size_t size_ = 0;
  std::size_t refused_ = 0;
};

}  // namespace ledgerline
