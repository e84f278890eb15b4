#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::agent {

/// Why the ledger that agent is shown is not to be believed as it is.
enum class DoubtKind : std::uint8_t {
  transaction = 0,  ///< cannot be what its flag says, by our own judgement
  records = 1,      ///< another organisation's peer tells other control records
  stop = 2,         ///< obeyed, though the ledger is said to have none such
  stream = 3,       ///< the stream contradicts itself, its orderers' signatures or an orderer's stream
  chain = 4         ///< a block does not follow the one before
};
inline constexpr std::size_t doubt_kinds = enum_count<DoubtKind>;
/// As in the log, in the summary and on the ledger.
std::string_view name(DoubtKind kind);

/// Whether agent doubts the ledger, and what is to be said of it. What cannot be believed is left out where it is
/// found; this only remembers that something was.
///
///                    a reason                        lasts_ns without one, and the records agree
///     believes ───────────────────▶ doubts (each reason counts anew) ───────────────────▶ believes
///
/// Pure; one thread; memory bounded: of each kind its count and its newest words.
class Doubt {
 public:
  static constexpr std::size_t max_words =
      300;  ///< bytes of one reason; more is cut. An alarm is an asset of the ledger
  /// Between two words of one kind: a peer may give thousands of reasons a second, and a log must not fill a disk.
  static constexpr TimeNs word_gap_ns = 60 * ns_per_s;

  struct Reason {
    std::uint64_t count = 0;
    std::uint64_t block = 0;  ///< of the newest; 0: of none
    std::string words;        ///< of the newest, printable
  };
  /// For the log.
  struct Word {
    DoubtKind kind{};
    std::uint64_t since = 0;  ///< reasons of this kind since the last word of it
    std::uint64_t count = 0;  ///< all of them
    std::string words;
  };

  explicit Doubt(TimeNs lasts_ns) : lasts_ns_(lasts_ns) {}

  /// `words` come from outside: cut, and made printable.
  void add(TimeNs now, DoubtKind kind, std::uint64_t block, std::string_view words, std::uint64_t times = 1);
  /// Whether another organisation's peer tells other records now: as long as it does, they are doubted.
  void records_differ(bool differ) { records_differ_ = differ; }

  bool stands(TimeNs now) const;
  bool stands(TimeNs now, DoubtKind kind) const;
  const Reason& of(DoubtKind kind) const { return at(kind).reason; }
  std::uint64_t count() const;  ///< of all kinds
  TimeNs lasts_ns() const { return lasts_ns_; }

  /// What is to be told now: the first reason of a kind at once, then at most a word each word_gap_ns.
  std::vector<Word> take_words(TimeNs now);

 private:
  struct Kept {
    Reason reason;
    std::optional<TimeNs> newest_ns;
    std::uint64_t untold = 0;
    std::optional<TimeNs> told_ns;
  };
  const Kept& at(DoubtKind kind) const { return kept_.at(static_cast<std::size_t>(kind)); }

  TimeNs lasts_ns_;
  std::array<Kept, doubt_kinds> kept_{};
  bool records_differ_ = false;
};

}  // namespace ledgerline::agent
