#pragma once
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>

#include "common/rt/clock.hpp"

// What the Tello's SDK promises of its calls (SDK 1.3 to 3.0; docs/sources.md), for those who stand between a client
// and a drone. Answers carry no id: whose they are is known by their order and by these rules alone.
namespace ledgerline::hil {

enum class Answered : std::uint8_t {
  never,    ///< rc, reboot
  at_once,  ///< settings, questions, stop, emergency: as soon as the drone has read it
  at_end,   ///< take-off, landing and moves: when they have ended
};

/// The command's first word: "takeoff" of "takeoff\r\n", "rc" of "rc 0 0 0 0"; empty where there is none.
std::string_view call_word(std::string_view command);

/// Nothing: it is no word of the SDK, which a Tello refuses at once.
std::optional<Answered> how_answered(std::string_view word);

/// True for commands that interrupt a running move: the move is answered first.
bool breaks_off(std::string_view word);

/// "error", "error Motor stop", "out of range", "unknown command: x".
bool is_refusal(std::string_view answer);

/// The commands of one drone that wait for their answers, to say whose an answer is. Answers carry no id. One belongs
/// to the oldest command that the drone answers at once and has not yet; without such, to the oldest that it answers at
/// its end. A refusal while `stop`, `land` or `emergency` waits is the move's that this broke off. A command that has
/// no answer after answer_lost_ns (a `land` during a take-off) is waited for no longer; the same word again is one
/// command. Beyond max_open the oldest is forgotten. One thread.
class OpenCalls {
 public:
  static constexpr std::size_t max_open = 16, max_word_bytes = 64;
  /// Longer than any move; a take-off takes up to 20 s.
  static constexpr TimeNs answer_lost_ns = 30 * ns_per_s;

  struct Call {
    std::string word;
    bool at_once = false;
    TimeNs since_ns = 0;    ///< it was said, the last time
    std::uint64_t tag = 0;  ///< of the last time
  };
  /// False where it has no answer (rc), or is nothing at all.
  bool command(TimeNs now, std::string_view bytes, std::uint64_t tag = 0);
  /// Removes and returns the call that this answers; nothing: there is none.
  std::optional<Call> match(TimeNs now, std::string_view answer);

 private:
  std::deque<Call> calls_;  // oldest first
};

}  // namespace ledgerline::hil
