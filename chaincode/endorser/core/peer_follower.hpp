#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "common/base/result.hpp"
#include "common/fabric/blocks/checkpoint.hpp"
#include "common/fabric/validation/channel_state.hpp"

/// How an endorser follows its peer: whose blocks it takes, when it may answer, and when it may write a checkpoint.
namespace ledgerline::endorser {

/// What the endorser's answer is beside a peer's to the same proposal.
enum class Comparison {
  same,         ///< byte for byte, but for the signature
  other_state,  ///< they have read other versions: one of them has not taken a block yet
  differ,       ///< from the same versions they conclude different things: one of them must not go on
};
/// Both are protos.ProposalResponse. Pure.
Comparison compare_answers(std::string_view own, std::string_view peers);

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
  bool needs_height() const { return connected_ && !height_known_; }
  /// Counts beginnings and ends of the stream.
  std::uint64_t connection() const { return connection_; }
  /// How many blocks the peer has; that was requested when `connection` was the newest. False: that is over, it is not
  /// taken.
  bool set_peer_height(std::uint64_t connection, std::uint64_t height);

  void fail() { failed_ = true; }
  bool failed() const { return failed_; }

  /// Whether it may answer. `height`: of the endorser's own state.
  Status check(std::uint64_t height) const;
  /// Whether the peer has once answered the same under the definition that counts now.
  bool has_agreed(const DefinedAt& now) const { return agreed_once_ && agreed_ == now; }
  /// An answer was compared that was made under `asked`. An error: why it must end for good.
  Status record_comparison(Comparison result, const DefinedAt& asked, const DefinedAt& now);

 private:
  static constexpr int max_apart = 3;  // checks in a row with other versions to their ends: no block is so late

  bool connected_ = false, failed_ = false, height_known_ = false, agreed_once_ = false;
  std::uint64_t connection_ = 0, peers_height_ = 0;
  DefinedAt agreed_;
  int apart_ = 0;
};

/// Whose blocks an endorser takes that has two sources: the peer's chain from its first block on, read for it alone,
/// and the stream that its process reads anyway, from some block on. Once the second is connected and has delivered a
/// block that is not beyond what was taken, it brings all others. The first is then not needed any more. Pure, one
/// thread at a time.
///
///     own stream ──▶ height ──▶ the shared stream's newest is below it: joined ──▶ the shared stream alone
class BlockSources {
 public:
  enum class Source : std::uint8_t { own, shared };

  /// Whether block `number`, which `from` delivers, is to be taken at this height. What is not is either known, or the
  /// other source brings it.
  bool accepts(Source from, std::uint64_t number, std::uint64_t height) {
    if (from == Source::shared) reported_ = number;
    if (joined_) return from == Source::shared && number >= height;
    return number == height || (from == Source::own && number > height);
  }
  void set_shared_connected(bool connected) { connected_ = connected; }
  /// Up to this height all is there. True: from now on it is the shared stream's.
  bool try_join(std::uint64_t height) {
    if (joined_ || !connected_ || !reported_ || is_behind_reader(height)) return false;
    joined_ = true;
    return true;
  }
  bool has_joined() const { return joined_; }
  /// The shared stream's reader knows a block that is not there yet: an answer would be of an older state than that.
  bool is_behind_reader(std::uint64_t height) const { return reported_ && *reported_ >= height; }
  /// Whether it is of this source's connection that the endorser lives.
  bool depends_on(Source source) const { return joined_ == (source == Source::shared); }

 private:
  std::optional<std::uint64_t> reported_;  ///< the shared stream's newest
  bool connected_ = false, joined_ = false;
};

/// When a checkpoint may be written: once the peer has delivered its block. A checkpoint whose block only an
/// orderer has delivered waits here; the next one takes its place. Pure, one thread at a time.
class PendingCheckpoint {
 public:
  /// The peer has delivered block `number`, whose header has this hash. What may be written now.
  std::optional<fabric::Checkpoint> on_peer_block(std::uint64_t number, const std::string& hash) {
    if (!reported_ || *reported_ < number) reported_ = number;
    if (!waiting_ || waiting_->number > number) return std::nullopt;
    auto due = std::exchange(waiting_, std::nullopt);
    // A difference ends the stream, and is reported elsewhere.
    if (due->number == number && due->hash != hash) return std::nullopt;
    return due;
  }
  /// What is known behind the newest block that was taken. The same.
  std::optional<fabric::Checkpoint> offer(fabric::Checkpoint newest) {
    waiting_.reset();
    if (reported_ && newest.number <= *reported_) return newest;
    waiting_ = std::move(newest);
    return std::nullopt;
  }

 private:
  std::optional<std::uint64_t> reported_;  ///< by the peer, the newest
  std::optional<fabric::Checkpoint> waiting_;
};

}  // namespace ledgerline::endorser
