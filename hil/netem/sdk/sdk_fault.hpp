#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "common/base/enum_count.hpp"
#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

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

}  // namespace ledgerline::hil
