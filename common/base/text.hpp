#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "common/base/result.hpp"

namespace ledgerline {

/// Makes text from outside printable, for logs, refusals and terminals: one line of valid UTF-8, at most `max_size`
/// bytes; whatever cannot be printed becomes "?". (Nothing to do with encryption.)
std::string printable(std::string_view text, std::size_t max_size = 1'000);

/// Whether a configuration (TOML) or figures (JSON) can hold it.
bool is_utf8(std::string_view text);

/// Empty where it is not set.
std::string environment_variable(const char* name);

/// As it stands in an element or an attribute of XML; a control but a newline becomes a space.
std::string xml_text(std::string_view text);

/// Of "192.168.10.1"; fails with words for a person.
Result<std::uint32_t> parse_ipv4(const std::string& text);
std::string ipv4_text(std::uint32_t address);

/// Whether it is HOST:PORT as gRPC and Fabric have it: a name, an IPv4 address or [IPv6]; the port at most 65535 (a
/// larger one would be cut to 16 bits in silence), and at least `least_port`: 0 lets a listener take a free one.
Status check_endpoint(std::string_view text, unsigned least_port = 1);

/// What readers of a binary format take its numbers and texts from. Once something is missing all that follows is
/// empty.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : left_(bytes) {}

  /// False: from here on nothing more is given.
  void expect(bool holds) { is_whole_ = is_whole_ && holds; }
  bool is_whole() const { return is_whole_; }
  bool at_end() const { return left_.empty(); }
  std::size_t left() const { return left_.size(); }

 protected:
  std::string_view read(std::uint64_t size) {
    expect(size <= left_.size());
    if (!is_whole_) return {};
    const std::string_view taken = left_.substr(0, size);
    left_.remove_prefix(size);
    return taken;
  }

 private:
  std::string_view left_;
  bool is_whole_ = true;
};

}  // namespace ledgerline
