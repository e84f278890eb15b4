#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/base/random.hpp"
#include "common/fabric/calls/outcome.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/onboard.hpp"
#include "common/rt/clock.hpp"
#include "common/rt/retry.hpp"
#include "onboard/agent/core/drone_name.hpp"

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
  /// Bytes of one reason; more is cut. An alarm is an asset of the ledger.
  static constexpr std::size_t max_text_bytes = 300;
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

/// Sends agent's integrity violations to the ledger like the failsafe's transitions: in calls of their own, never
/// queued behind states. A call goes out when the ledger becomes untrusted, when it is trusted again, and between the
/// two, at most each gap_ns, when there are more reasons. One call in flight, of all drones; repeated after a back-off
/// with jitter, with what is true then: the newest wins, so nothing queues. Once the contract has refused a call, each
/// drone has a call of its own, and one that is refused by itself waits gap_ns: a drone that is another's by now must
/// not silence the rest. One thread; the same inputs and seed give the same calls.
class AlarmSender {
 public:
  /// Between two calls while one lasts: transactions of two organisations' endorsements, which report only a count.
  static constexpr TimeNs gap_ns = 60 * ns_per_s;

  struct Counters {
    std::uint64_t on_ledger = 0, repeated = 0, refused = 0;
  };
  struct Sending {
    std::uint64_t number = 0;  ///< for finished()
    std::vector<const DroneName*> drones;
  };

  AlarmSender(const BackOffLimits& back_off, const std::vector<DroneName>& drones, std::uint64_t seed);

  /// A call to make now, if any; it is then in flight.
  std::optional<Sending> next(TimeNs now, const IntegrityMonitor& integrity);
  /// How call `number` ended; false if it is none of ours.
  bool finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome);

  bool has_call_in_flight() const { return call_ != 0; }
  const Counters& counters() const { return counters_; }

 private:
  struct ReportedAlarm {
    bool stands = false;
    std::uint64_t count = 0;
  };
  struct Slot {
    DroneName drone{};
    ReportedAlarm reported{};
    TimeNs rest_until_ns = INT64_MIN;  ///< no call for its sake before, unless the ledger becomes trusted or untrusted
    bool refused = false;              ///< by itself: not even then
    bool sending = false;
  };
  bool is_due(const Slot& slot, TimeNs now, const ReportedAlarm& truth) const;

  std::vector<Slot> slots_;
  BackOff pause_;
  Random random_;
  Counters counters_;
  ReportedAlarm sending_{};  ///< what the call in flight says
  std::uint64_t call_ = 0;   ///< in flight; 0: none
  bool alone_ = false;
  std::uint64_t last_call_ = 0;
};

/// The call, with an asset `<drone>/alarm` for each drone. `real_offset_ns`: as for encode_batch.
fabric::Call encode_alarm(const AlarmSender::Sending& sending, const IntegrityMonitor& integrity, TimeNs now,
                          TimeNs real_offset_ns);

}  // namespace ledgerline::agent
