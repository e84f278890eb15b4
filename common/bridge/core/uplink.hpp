#pragma once
#include <array>
#include <boost/circular_buffer.hpp>
#include <cstdint>
#include <deque>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/bridge/core/rules.hpp"
#include "common/bridge/core/set_call.hpp"
#include "common/fabric/calls/in_flight.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/contract.hpp"
#include "common/rt/histogram.hpp"
#include "common/rt/retry.hpp"

namespace ledgerline::bridge {

/// Why a message did not get onto the ledger.
enum class Drop : std::uint8_t {
  rate,          ///< the topic's rate limit, or not the n-th
  replaced,      ///< only the newest may wait, and a newer one came
  overflow,      ///< too many wait: the oldest
  too_big,       ///< above what a call, or a host's batch, may have
  refused,       ///< by the contract
  unavailable,   ///< its call did not get through, and a newer message of the topic did
  type_changed,  ///< it waited while its topic took another type
};
inline constexpr std::size_t drop_count = enum_count<Drop>;
constexpr std::string_view name(Drop drop) { return enum_name(drop); }

/// Always: taken = on_ledger + all drops + pending.
struct UplinkCounters {
  std::uint64_t taken = 0, on_ledger = 0, bytes = 0;
  std::uint64_t pending = 0;  ///< waiting or in flight
  std::uint64_t batches = 0;  ///< transactions on the ledger that it rode in
  std::array<std::uint64_t, drop_count> drops{};
  Histogram age;                                ///< from the take off DDS until it was committed
  std::uint64_t dds_lost = 0, dds_refused = 0;  ///< never taken: reported by DDS for the topic's reader
};

struct UplinkConfig {
  std::vector<Rule> rules;  ///< those to the ledger count
  std::vector<std::string> enrolled;
  std::string msp_id;
  std::uint64_t writer = 0, life = 0;  ///< see Origin
  TimeNs min_gap_ns = 10 * ns_per_ms;
  BackOffLimits back_off{};
  TimeNs refused_pause_ns = 1 * ns_per_s;  ///< of a topic that the contract refused
  double bulk_share = 0.005;               ///< half of what may show in a p99
  bool beside = false;                     ///< big messages always yield: to the program's own traffic
  std::uint64_t seed = 1;
};

/// From DDS to the ledger: few transactions, many messages. Three kinds of call, each with its own pacing (one in
/// flight until it is committed; where that takes long, the next one behind a gap):
///
///     own     `set`: each topic has a key of its own
///     stream  `set` with stream: all such topics in this host's one key, so a call repeats the last value of those
///             that have nothing new
///     bulk    topics that had a message above big_bytes: one such message a call, one call at a time; the caller gives
///             it a client of its own, so that nothing small waits behind it. All share the ledger's blocks, though:
///             while a small topic of higher priority is active, big messages are on their way bulk_share of the time
///             at most
///
/// Topics of higher priority go first, of equal ones the oldest message. A topic's messages stay in order, also when a
/// call fails: until all of its kind have ended none is made, then what failed goes again, except behind a newer
/// message that got through (Drop::unavailable). A call whose fate is unknown may be on the ledger twice; readers drop
/// the second by its sequence. Every topic's queue is bounded by count and bytes; the oldest message makes room.
///
/// One thread; deterministic: the same inputs and seed give the same calls. In steady state nothing is allocated per
/// message, only per call.
class Uplink {
 public:
  static constexpr std::size_t max_topics = 256;
  static constexpr std::size_t max_queued_bytes = 8'000'000;  ///< of a topic
  static constexpr std::size_t big_bytes = 8'000;
  static constexpr std::size_t max_call_bytes = 128'000;  ///< of own: more goes with the next
  /// With its id and type a call of its own.
  static constexpr std::size_t max_message_bytes = contract::max_call_bytes - 1'000;

  struct Topic {
    std::string name, id, type;
    const Rule* rule = nullptr;
    UplinkCounters counters;
    std::string unheard{};  ///< why somebody who writes it is not heard; empty: all are
  };
  struct Submit {
    std::uint64_t number = 0;  ///< give it back to finished()
    fabric::Call call;
    bool bulk = false;
  };

  explicit Uplink(UplinkConfig config);

  /// A topic of DDS has come up, or its type is another now. Its number for add(); an error where no rule wants it, its
  /// type is not the rule's, or there are max_topics.
  Result<std::size_t> open(const std::string& ros_topic, const std::string& type);
  /// A message of a topic, in the order of DDS. `source_ns`: real time, when it was written.
  void add(TimeNs now, std::size_t topic, TimeNs source_ns, std::span<const std::uint8_t> cdr);
  /// What DDS did not hand over since the last time.
  void record_dds_losses(std::size_t topic, std::uint64_t lost, std::uint64_t refused);
  void set_unheard(std::size_t topic, std::string why) { topics_[topic].unheard = std::move(why); }
  /// For the log: of each topic, that something was lost for a reason that its rule does not ask for, once a reason.
  std::vector<std::string> pop_notices() { return std::exchange(notices_, {}); }
  /// The call to submit now, if any; ask again until there is none.
  std::optional<Submit> next(TimeNs now);
  void finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome);

  /// Something waits, so next() may have a call soon.
  bool has_waiting() const { return waiting_ > 0; }
  std::size_t calls_in_flight() const;
  const std::deque<Topic>& topics() const { return topics_; }

 private:
  enum Kind : std::uint8_t { own, stream, bulk, kinds };
  struct Message {
    std::size_t topic = 0;
    std::uint32_t generation = 0;  ///< of the topic's type
    std::uint64_t sequence = 0;
    TimeNs taken_ns = 0, source_ns = 0;
    std::string cdr;
  };
  /// What next() needs of a topic, beside what is shown.
  struct Slot {
    explicit Slot(std::size_t capacity) : queue(capacity) {}
    boost::circular_buffer<Message> queue;
    std::size_t queued_bytes = 0;
    Kind kind = own;
    bool big = false;
    std::size_t in_flight = 0;  ///< those that failed and wait for the others to end, too
    std::uint32_t generation = 0;
    std::uint64_t seen = 0, sequence = 0, committed = 0;  ///< messages of DDS; given out; newest on the ledger
    TimeNs next_by_rate_ns = INT64_MIN / 2;
    TimeNs paused_until_ns = INT64_MIN;
    TimeNs heard_ns = INT64_MIN / 2;
    std::uint64_t last_call = 0, last_batch = 0;  ///< made, committed
    Message newest;                               ///< stream: what the batch says of it
    bool has_newest = false;
  };
  using Messages = std::vector<Message>;  ///< of a call
  struct Lane {
    Lane(const UplinkConfig& config) : pause(config.back_off) {}
    BackOff pause;
    fabric::InFlight<Messages> in_flight;
    Messages failed;  ///< not empty: no call until in_flight is
  };

  bool ready(const Lane& lane, Kind kind, TimeNs now) const;
  bool must_yield(std::size_t big, TimeNs now) const;
  /// Whether the topic's next message may go in a call of this kind; moves big ones to bulk.
  bool assign_lane(std::size_t topic, Kind kind, TimeNs now);
  std::optional<std::size_t> first_topic(Kind kind, TimeNs now);
  std::optional<Submit> make_call(Kind kind, TimeNs now);
  bool fits_batch(const Message& message) const;
  void repeat_others(std::string& call, std::uint64_t number);
  void append(std::string& call, const Message& message) const;
  void on_refused(TimeNs now, Lane& lane, Messages& messages, const fabric::Outcome& outcome);
  void send_again(Lane& lane);
  void drop(Message message, Drop why);
  void recycle(Message message);
  Message pop(std::size_t topic);
  std::size_t size_of(const Message& message) const;

  UplinkConfig config_;
  std::deque<Topic> topics_;
  std::vector<Slot> slots_;  ///< as topics_
  std::vector<Lane> lanes_;
  std::vector<std::string> spare_;     ///< bytes of messages that are done with
  std::vector<Messages> spare_calls_;  ///< the same of calls
  Random random_;
  std::uint64_t last_number_ = 0;
  std::size_t waiting_ = 0;
  std::vector<std::string> notices_;
  TimeNs bulk_again_ns_ = INT64_MIN;  ///< where big messages must yield, none before
};

/// Each topic with what it cost and lost: topic, type, id, direction, messages, bytes, batches, pending, missing,
/// age_ms, drops by reason (those that there are), unheard where somebody is not.
nlohmann::json report(const Uplink& uplink);

}  // namespace ledgerline::bridge
