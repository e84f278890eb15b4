#pragma once
#include <algorithm>
#include <string>
#include <string_view>

#include "common/crypto/crypto.hpp"
#include "common/rt/trace.hpp"

namespace ledgerline::hil {

/// SHA-256 of everything that is put in, compressed to a digest after each megabyte.
class Digester {
 public:
  void put(std::string_view bytes) {
    buffer_.append(bytes);
    if (buffer_.size() > 1'000'000) compress();
  }
  void put(const TraceRecord& record) { put({reinterpret_cast<const char*>(&record), sizeof record}); }
  crypto::Digest result() {
    compress();
    crypto::Digest digest{};
    std::copy(buffer_.begin(), buffer_.end(), digest.begin());
    return digest;
  }

 private:
  void compress() {
    const crypto::Digest digest = crypto::sha256(buffer_);
    buffer_.assign(digest.begin(), digest.end());
  }
  std::string buffer_;
};

}  // namespace ledgerline::hil
