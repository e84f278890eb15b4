#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "common/common.pb.h"

namespace ledgerline::fabric {

/// Headers that one of two streams of the same chain has delivered and the other has not yet. Neither waits for the
/// other: of each side the newest max_kept are kept. Pure; one thread.
class ReportedHeaders {
 public:
  static constexpr std::size_t max_kept = 1024;
  static constexpr std::size_t max_signatures_bytes = 16 << 10;  ///< more are as good as none

  struct Ordered {
    std::string hash;       ///< block_header_hash
    common::Block message;  ///< without its data: what is signed, and the signatures
  };
  void ordered(const common::Block& message, std::string hash);
  /// Another orderer delivers from now on.
  void forget_ordered();
  void of_peer(std::uint64_t number, std::string hash);
  /// What the other side delivered of that block, which is then forgotten.
  std::optional<Ordered> take_ordered(std::uint64_t number);
  std::optional<std::string> take_of_peer(std::uint64_t number);

 private:
  std::map<std::uint64_t, Ordered> ordered_;
  std::map<std::uint64_t, std::string> of_peer_;
};

}  // namespace ledgerline::fabric
