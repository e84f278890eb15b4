#pragma once
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace ledgerline {

/// What readers of a binary format take its numbers and texts from. Once something is missing all that follows is
/// empty.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : left_(bytes) {}

  /// False: from here on nothing more is given.
  void expect(bool holds) { whole_ = whole_ && holds; }
  bool whole() const { return whole_; }
  bool at_end() const { return left_.empty(); }
  std::size_t left() const { return left_.size(); }

 protected:
  std::string_view take(std::uint64_t size) {
    expect(size <= left_.size());
    if (!whole_) return {};
    const std::string_view taken = left_.substr(0, size);
    left_.remove_prefix(size);
    return taken;
  }

 private:
  std::string_view left_;
  bool whole_ = true;
};

}  // namespace ledgerline
