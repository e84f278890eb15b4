#pragma once
#include <cstdint>
#include <optional>

namespace ledgerline::endorser {

/// Whose blocks an endorser takes that has two sources: the peer's chain from its first block on, read for it alone,
/// and the stream that its process reads anyway, from some block on. Once the second is connected and has delivered a
/// block that is not beyond what was taken, it brings all others. The first is then not needed any more. Pure, one
/// thread at a time.
///
///     own stream ──▶ height ──▶ the shared stream's newest is below it: joined ──▶ the shared stream alone
class Feed {
 public:
  enum class Source : std::uint8_t { own, shared };

  /// Whether block `number`, which `from` delivers, is to be taken at this height. What is not is either known, or the
  /// other source brings it.
  bool wants(Source from, std::uint64_t number, std::uint64_t height) {
    if (from == Source::shared) reported_ = number;
    if (joined_) return from == Source::shared && number >= height;
    return number == height || (from == Source::own && number > height);
  }
  void shared_connected(bool connected) { connected_ = connected; }
  /// Up to this height all is there. True: from now on it is the shared stream's.
  bool joins(std::uint64_t height) {
    if (joined_ || !connected_ || !reported_ || *reported_ >= height) return false;
    joined_ = true;
    return true;
  }
  bool joined() const { return joined_; }
  /// Whether it is of this source's connection that the endorser lives.
  bool follows(Source source) const { return joined_ == (source == Source::shared); }

 private:
  std::optional<std::uint64_t> reported_;  ///< the shared stream's newest
  bool connected_ = false, joined_ = false;
};

}  // namespace ledgerline::endorser
