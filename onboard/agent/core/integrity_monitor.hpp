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

/// Why the ledger that agent is shown is not to be trusted as it is.
enum class IntegrityViolation : std::uint8_t {
  transaction = 0,  ///< cannot be what its flag says, by our own validation
  records = 1,      ///< another organisation's peer reports other control records
  stop = 2,         ///< obeyed, though the ledger is said to have none such
  stream = 3,       ///< the stream contradicts itself, its orderers' signatures or an orderer's stream
  chain = 4         ///< a block does not follow the one before
};
inline constexpr std::size_t violation_kinds = enum_count<IntegrityViolation>;
/// As in the log, in the summary and on the ledger.
std::string_view name(IntegrityViolation kind);

/// Whether agent does not trust the ledger, and what is to be said of it. What cannot be trusted is left out where it
/// is found; this only remembers that something was.
///
///                    a reason                        lasts_ns without one, and the records agree
///     trusted ───────────────────▶ untrusted (each one starts it again) ───────────────────▶ trusted
///
/// Pure; one thread; memory bounded: of each kind its count and its newest words.
class IntegrityMonitor {
 public:
  static constexpr std::size_t max_text_bytes =
      300;  ///< bytes of one reason; more is cut. An alarm is an asset of the ledger
  /// Between two log entries of one kind: a peer may give thousands of reasons a second, and a log must not fill a
  /// disk.
  static constexpr TimeNs log_gap_ns = 60 * ns_per_s;

  struct Reason {
    std::uint64_t count = 0;
    std::uint64_t block = 0;  ///< of the newest; 0: of none
    std::string words;        ///< of the newest, printable
  };
  /// For the log.
  struct LogEntry {
    IntegrityViolation kind{};
    std::uint64_t since = 0;  ///< reasons of this kind since the last entry of it
    std::uint64_t count = 0;  ///< all of them
    std::string words;
  };

  explicit IntegrityMonitor(TimeNs lasts_ns) : lasts_ns_(lasts_ns) {}

  /// `words` come from outside: cut, and made printable.
  void add(TimeNs now, IntegrityViolation kind, std::uint64_t block, std::string_view words, std::uint64_t times = 1);
  /// Whether another organisation's peer reports other records now: as long as it does, they are not trusted.
  void records_differ(bool differ) { records_differ_ = differ; }

  bool stands(TimeNs now) const;
  bool stands(TimeNs now, IntegrityViolation kind) const;
  const Reason& of(IntegrityViolation kind) const { return at(kind).reason; }
  std::uint64_t count() const;  ///< of all kinds
  TimeNs lasts_ns() const { return lasts_ns_; }

  /// What is to be reported now: the first reason of a kind at once, then at most one each log_gap_ns.
  std::vector<LogEntry> pop_log_entries(TimeNs now);

 private:
  struct Violations {
    Reason reason;
    std::optional<TimeNs> newest_ns;
    std::uint64_t unreported = 0;
    std::optional<TimeNs> reported_ns;
  };
  const Violations& at(IntegrityViolation kind) const { return all_.at(static_cast<std::size_t>(kind)); }

  TimeNs lasts_ns_;
  std::array<Violations, violation_kinds> all_{};
  bool records_differ_ = false;
};

}  // namespace ledgerline::agent
