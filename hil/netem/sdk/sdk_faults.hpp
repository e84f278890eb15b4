#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/base/random.hpp"
#include "common/base/result.hpp"
#include "common/rt/clock.hpp"
#include "hil/netem/sdk/calls.hpp"

namespace ledgerline::hil {

/// One fault at the SDK's own calls: of a drone's answers or of its state text. Plain data.
struct SdkFault {
  enum class Kind : std::uint8_t {
    late,         ///< an answer comes `time_ns` later
    wrong,        ///< error for ok, and for a value; ok for a refusal
    garbage,      ///< something that the SDK never answers
    missing,      ///< an answer never comes
    twice,        ///< an answer comes again, `time_ns` later
    other,        ///< the text of the answer before, in the place of its own
    shifted,      ///< an answer is kept until the client says the next command, and comes at once then: off by one
    torn,         ///< a state text ends inside a field, or is half of it and half of the one before
    stale,        ///< a state text of a while ago, again
    other_drone,  ///< the newest state text of another drone
  };
  Kind kind{};
  TimeNs time_ns = 0;     ///< late, twice
  double share = 1;       ///< of the answers or texts that it is about, each by itself
  std::string command{};  ///< answers: to this word of the SDK alone; empty: to every one
  std::size_t item = 0;   ///< which of the drone's faults it is, so that SdkFaults::set() knows it again
};
inline constexpr std::size_t sdk_fault_kinds = enum_count<SdkFault::Kind>;

inline bool of_states(SdkFault::Kind kind) { return kind >= SdkFault::Kind::torn; }
/// As it is written: "late", and of states "torn", "stale", "other".
std::string_view name_of(SdkFault::Kind kind);

/// Reads one of
///     answers late TIME [SHARE] [to COMMAND]
///     answers wrong|garbage|missing|other|shifted [SHARE] [to COMMAND]
///     answers twice [TIME] [SHARE] [to COMMAND]     the second one so much later; without a time at once
///     states torn|stale|other [SHARE]
/// TIME as 300ms, SHARE as 30% (without: all of them), COMMAND a word of the SDK or * for every one; rc is refused: it
/// has no answer. The error quotes what is wrong and says what is allowed.
Result<SdkFault> parse_sdk_fault(std::string_view text);
/// What parse_sdk_fault() reads as the same again.
std::string text_of(const SdkFault& fault);

/// Stands at the drones' ends of their links and knows the SDK's calls: answers come late, wrong, not at all, twice or
/// for another command, state texts torn, old or of another drone. What no fault is about comes out at once, as it is
/// and in its order. A core: no clock, no socket; the same seed, faults and bytes give the same bytes at the same
/// times, and each fault has random numbers of its own. One thread; `now` never goes back.
///
/// Whose answer it is: OpenCalls.
///
/// Faults of one drone act together: first which text is said (other, wrong, garbage; stale, other, then torn), then
/// whether it is said (missing, shifted), then when (late, twice). Times of several `late` add up. What
/// `shifted` keeps comes with the next command, once and at once: to that answer late and twice do nothing.
///
/// Bounded: of each drone at most max_waiting units on their way, beyond which one that comes is dropped and counted
/// (no_room), and max_texts old state texts. What is longer than max_bytes is no Tello's: no fault touches it, and
/// nothing remembers it.
class SdkFaults {
 public:
  static constexpr std::size_t max_waiting = 256, max_texts = 100, max_bytes = 2'048;

  SdkFaults(std::uint64_t seed, std::size_t drones);

  /// All that this drone (an index) has from now on; one that it had before, by `item` and kind, goes on with its
  /// random numbers. What was late comes when it was due; what `shifted` keeps comes at once when that fault has ended.
  /// An error, and nothing changed: the state of another drone where there is none.
  Status set(std::size_t drone, std::vector<SdkFault> faults);

  /// What the client said, as it gets to the drone.
  void command(TimeNs now, std::size_t drone, std::string_view bytes);
  /// What the drone answered, and its state text.
  void answer(TimeNs now, std::size_t drone, std::string_view bytes);
  void state(TimeNs now, std::size_t drone, std::string_view bytes);

  struct Unit {
    std::size_t drone = 0;
    bool is_state = false;
    std::string bytes{};
  };
  /// The next one that is due; call until there is none.
  std::optional<Unit> pop(TimeNs now);
  /// When pop() will give something; none: not before something is said.
  std::optional<TimeNs> next_due() const;

  struct Counts {
    std::uint64_t answers = 0, states = 0;  ///< that came in
    std::uint64_t no_room = 0;
    std::array<std::uint64_t, sdk_fault_kinds> struck{};  ///< by SdkFault::Kind
  };
  const Counts& counts() const { return counts_; }

 private:
  struct Live {
    SdkFault fault;
    Random random;
  };
  struct Drone {
    std::vector<Live> faults;
    OpenCalls calls;
    std::string last_answer;          ///< empty: none yet
    std::optional<std::string> held;  ///< of `shifted`
    std::deque<std::string> texts;    ///< state texts as the drone said them, oldest first
    std::size_t waiting = 0;
  };
  /// Whether this fault acts now; counts it.
  bool draw_strike(Live& live);
  const std::string* text_of_another(std::size_t drone, Random& random) const;
  void add_unit(TimeNs due, std::size_t drone, bool is_state, std::string bytes);

  std::uint64_t seed_;
  std::vector<Drone> drones_;
  std::map<std::pair<TimeNs, std::uint64_t>, Unit> units_;  // by when they are due, then as they came
  std::uint64_t next_number_ = 0;
  Counts counts_;
};

/// What a drone's state text ("...;tof:10;h:0;bat:100;...") says wrongly.
struct SensorFault {
  enum class Kind { stuck, garbage, bias, says, every } kind{};
  std::string field;  ///< of the state text: "h", "tof", "bat" ...; empty: all of it (stuck, garbage, every)
  double bias = 0;    ///< in the text's unit; says: the value
  double share = 1;   ///< of the texts, each by itself
  TimeNs period_ns = 0;
  std::size_t item = 0;  ///< which of the drone's faults it is, so that it is known again: see renew()
  std::string last{};    ///< stuck: what it said first
  TimeNs next_ns = 0;
};

/// "h stuck", "all garbage", "bat bias -95", "vgx says 5", "all every 700ms"; a share of the texts behind it: "yaw
/// stuck 30%".
Result<SensorFault> parse_sensor(std::string_view text);

/// Puts `faults` in the place of those before; one that was there already remembers what it said.
void renew(std::vector<SensorFault>& known, std::vector<SensorFault> faults);

/// Changes a state text as the faults say, which remember what they need. False: it is not said at all.
bool misreport(TimeNs now, std::vector<SensorFault>& faults, Random& random, std::string& text);

}  // namespace ledgerline::hil
