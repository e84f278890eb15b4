#pragma once
#include <string.h>

#include <memory>
#include <string>
#include <string_view>
#include <utility>

namespace ledgerline::crypto {

/// Overwrites the whole buffer, which is more than the text, and leaves an empty one.
inline void wipe(std::string& text) noexcept {
  text.resize(text.capacity());
  ::explicit_bzero(text.data(), text.size());
  text.clear();
}

/// A secret, as a pass phrase or a key: its bytes are overwritten when it ends. It is moved and never copied, and has
/// no capacity to grow, so no second buffer is left behind. Its owner may lend view() for the time of a call.
class WipingString {
 public:
  WipingString() = default;
  explicit WipingString(std::string_view text) : size_(text.size()), bytes_(std::make_unique<char[]>(text.size() + 1)) {
    text.copy(bytes_.get(), text.size());
  }
  /// Wipes what it was made of.
  explicit WipingString(std::string&& text) : WipingString(std::string_view(text)) { wipe(text); }
  WipingString(WipingString&& other) noexcept : size_(std::exchange(other.size_, 0)), bytes_(std::move(other.bytes_)) {}
  WipingString& operator=(WipingString&& other) noexcept {
    std::swap(size_, other.size_);
    std::swap(bytes_, other.bytes_);
    other.clear();
    return *this;
  }
  ~WipingString() { clear(); }

  void clear() noexcept {
    if (bytes_) ::explicit_bzero(bytes_.get(), size_);
    bytes_.reset();
    size_ = 0;
  }

  std::string_view view() const noexcept { return {bytes_.get(), size_}; }
  /// Ends with a zero.
  const char* c_str() const noexcept { return bytes_ ? bytes_.get() : ""; }
  bool empty() const noexcept { return size_ == 0; }
  std::size_t size() const noexcept { return size_; }

 private:
  std::size_t size_ = 0;
  std::unique_ptr<char[]> bytes_;
};

}  // namespace ledgerline::crypto
