#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/rt/trace.hpp"

namespace ledgerline::timing {

/// The places that a sample comes by, in order: as a state to the ground, as the command made from it back.
enum class Mark : std::uint8_t {
  sampled,
  taken,
  batched,
  endorsed,
  ordered,
  delivered,
  made,
  submitted,
  command_endorsed,
  command_ordered,
  in_block,
  picked_up,
  verified,
  received,
  applied,
  sent,
  at_device,
};
inline constexpr std::size_t mark_count = enum_count<Mark>;

/// Whose trace records are from.
enum class Writer : std::uint8_t { link, agent, ground };

/// One sample's way. Times are of one clock: traces of another host must not be given.
struct SampleTrace {
  std::uint16_t drone = 0;
  std::uint64_t sequence = 0;              ///< of the state
  std::array<TimeNs, mark_count> at_ns{};  ///< 0: did not come by there, or nobody wrote it down
  TimeNs late_ns = 0;                      ///< its setpoint: sent minus meant
  TimeNs margin_ns = 0;                    ///< that playout kept to when the plan came

  TimeNs at(Mark mark) const { return at_ns[static_cast<std::size_t>(mark)]; }
  bool has(Mark mark) const { return at(mark) != 0; }
  Mark last() const;
  /// Its setpoint was meant for a moment that, playout's margin included, had passed when link got the plan: nothing
  /// was held back on purpose.
  bool due_at_once() const;
};

/// Joins the records of a flight to traces, whatever order they come in. A sample is known by its drone and stamp,
/// which every later record carries. Rules:
///   - of records that are there twice the first counts; of a sample that rode in two batches (the first one
///     was refused), or a plan in two calls, the last;
///   - the orderer's acknowledgement may come after the block itself, or not at all: then the block's time counts;
///   - a device may have the datagram before the call that sent it returns: it then counts as had when sent;
///   - link stamps with the beginning of its turn; a plan that came within the turn counts as received when verified;
///   - a record whose sample link did not write down is a stray: not part of any trace;
///   - a trace whose times go backwards (a damaged trace) is left out.
/// One thread.
class SampleTraces {
 public:
  struct Counters {
    std::uint64_t doubled = 0, strays = 0, backwards = 0;
  };

  /// `life`: counts up when the writer was started again, since the numbers of its transactions restart with it.
  void add(Writer writer, std::span<const TraceRecord> records, std::uint32_t life = 0);
  /// The traces sampled before that time, in order of it; they are then forgotten.
  std::vector<SampleTrace> pop(TimeNs sampled_before_ns = INT64_MAX);
  const Counters& counters() const { return counters_; }

 private:
  using CallKey = std::pair<std::uint32_t, std::uint64_t>;  ///< life of the writer, number
  struct Open {
    SampleTrace trace;
    CallKey batch{}, call{};  ///< number 0: none
  };
  struct Call {
    TimeNs submitted_ns = 0, endorsed_ns = 0, ordered_ns = 0;
  };
  using Calls = std::map<CallKey, Call>;

  void add(Writer writer, const TraceRecord& record, std::uint32_t life);
  void set_mark(const TraceRecord& record, Mark mark, std::uint32_t life);
  bool finish(Open& open) const;

  std::map<std::pair<TimeNs, std::uint16_t>, Open> open_;
  Calls batches_, calls_;  ///< the transactions of agent (batches of states) and of ground (its calls)
  Counters counters_;
};

}  // namespace ledgerline::timing
