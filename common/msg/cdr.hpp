#pragma once
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>

namespace ledgerline {

/// CDR as ROS 2 sends it (OMG DDSI-RTPS 2.2, 10.2; XCDR1, PLAIN_CDR little-endian): four bytes of encapsulation header,
/// then primitives aligned to their own size, counted from behind the header. Strings carry their length with the final
/// NUL, sequences their count, both as uint32.
class CdrWriter {
 public:
  CdrWriter() : bytes_{0, 1, 0, 0} {}

  template <typename T>
  requires std::is_arithmetic_v<T>
  void put(T value) {
    static_assert(std::endian::native == std::endian::little);
    align(sizeof(T));
    const auto* p = reinterpret_cast<const char*>(&value);
    bytes_.append(p, sizeof(T));
  }
  void put(std::string_view text) {
    put(static_cast<std::uint32_t>(text.size() + 1));
    bytes_.append(text);
    bytes_.push_back('\0');
  }
  template <typename T, std::size_t N>
  void put(const std::array<T, N>& values) {
    for (const T& v : values) put(v);
  }

  /// These, one after the other.
  template <typename... T>
  void operator()(const T&... values) {
    (put(values), ...);
  }

  std::string release() { return std::move(bytes_); }

 private:
  void align(std::size_t n) {
    while ((bytes_.size() - 4) % n != 0) bytes_.push_back('\0');
  }
  std::string bytes_;
};

/// Reads what CdrWriter or any ROS 2 node wrote, in either byte order. After the first read beyond the end, or of a
/// length that cannot be, `ok()` is false and every further value is zero or empty: check once, at the end.
class CdrReader {
 public:
  explicit CdrReader(std::span<const char> bytes) : bytes_(bytes) {
    if (bytes.size() < 4 || bytes[0] != 0 || (bytes[1] != 0 && bytes[1] != 1)) {
      ok_ = false;
      return;
    }
    swap_ = bytes[1] == 0;
    at_ = 4;
  }

  template <typename T>
  requires std::is_arithmetic_v<T> T get() {
    while ((at_ - 4) % sizeof(T) != 0) ++at_;
    if (!ok_ || at_ > bytes_.size() || bytes_.size() - at_ < sizeof(T)) {
      ok_ = false;
      return T{};
    }
    std::array<char, sizeof(T)> raw{};
    std::memcpy(raw.data(), bytes_.data() + at_, sizeof(T));
    if (swap_) {
      for (std::size_t i = 0; i < sizeof(T) / 2; ++i) std::swap(raw[i], raw[sizeof(T) - 1 - i]);
    }
    at_ += sizeof(T);
    return std::bit_cast<T>(raw);
  }
  std::string get_string() {
    const auto size = get<std::uint32_t>();
    if (!ok_ || size == 0 || bytes_.size() - at_ < size || bytes_[at_ + size - 1] != '\0') {
      ok_ = false;
      return {};
    }
    std::string text(bytes_.data() + at_, size - 1);
    at_ += size;
    return text;
  }
  template <typename T, std::size_t N>
  std::array<T, N> get_array() {
    std::array<T, N> values{};
    for (T& v : values) v = get<T>();
    return values;
  }

  /// These, one after the other.
  template <typename... T>
  void operator()(T&... values) {
    (read(values), ...);
  }

  bool ok() const { return ok_; }

 private:
  template <typename T>
  void read(T& value) {
    value = get<T>();
  }
  void read(std::string& text) { text = get_string(); }
  template <typename T, std::size_t N>
  void read(std::array<T, N>& values) {
    values = get_array<T, N>();
  }

  std::span<const char> bytes_;
  std::size_t at_ = 4;
  bool swap_ = false;
  bool ok_ = true;
};

}  // namespace ledgerline
