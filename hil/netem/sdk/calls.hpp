#pragma once
#include <cstdint>
#include <optional>
#include <string_view>

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

/// A move that goes on is answered before this one is: it breaks it off.
bool breaks_off(std::string_view word);

/// "error", "error Motor stop", "out of range", "unknown command: x".
bool is_refusal(std::string_view answer);

}  // namespace ledgerline::hil
