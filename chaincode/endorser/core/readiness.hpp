#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "chaincode/endorser/core/comparison.hpp"
#include "chaincode/node/core/types.hpp"
#include "common/fabric/validation/channel_state.hpp"

namespace ledgerline::endorser {

/// Whether the endorser may answer, and whether it must end. Pure, one thread at a time.
///
///     stream begins ──▶ the peer says its height ──▶ all those blocks are there ──▶ it may answer
///     stream ends ──▶ none of this counts any more          fail() ──▶ never again
///
/// Under a definition of the contract that is new to it, it signs only after the peer has once answered the same.
class Readiness {
 public:
  /// Where the definition that counts was committed; none on the embedded node.
  using DefinedAt = std::optional<fabric::Version>;

  /// The stream has begun or ended. What came while it was gone is known to be there only once the peer has said how
  /// many blocks it has.
  void on_connection(bool connected);
  bool connected() const { return connected_; }
  bool wants_height() const { return connected_ && !height_known_; }
  /// Counts beginnings and ends of the stream.
  std::uint64_t connection() const { return connection_; }
  /// How many blocks the peer has; it was asked when `connection` was the newest. False: that is over, it is not taken.
  bool take_height(std::uint64_t connection, std::uint64_t height);

  void fail() { failed_ = true; }
  bool failed() const { return failed_; }

  /// `height`: of the endorser's own state. Empty: it may answer.
  std::string why_not(std::uint64_t height) const;
  bool ready(std::uint64_t height) const { return why_not(height).empty(); }
  /// Whether the peer has once answered the same under the definition that counts now.
  bool agreed(const DefinedAt& now) const { return agreed_once_ && agreed_ == now; }
  /// A check's end; it was made under `asked`. A reason to end for good, or empty.
  std::string take_check(Comparison found, const DefinedAt& asked, const DefinedAt& now);

 private:
  static constexpr int max_apart = 3;  // checks in a row with other versions to their ends: no block is so late

  bool connected_ = false, failed_ = false, height_known_ = false, agreed_once_ = false;
  std::uint64_t connection_ = 0, peers_height_ = 0;
  DefinedAt agreed_;
  int apart_ = 0;
};

}  // namespace ledgerline::endorser
