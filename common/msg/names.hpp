#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "common/base/enum_count.hpp"
#include "common/msg/onboard.hpp"

/// The words for what link says: in logs, status lines, summaries and on the ledger.
namespace ledgerline {

constexpr std::string_view name(LinkPhase phase) noexcept { return enum_name(phase); }
constexpr std::string_view name(FailsafeMode mode) noexcept { return enum_name(mode); }
constexpr std::string_view name(FailsafeCause cause) noexcept { return enum_name(cause); }

/// The same in a sentence: "its failsafe landed it: ...".
constexpr const char* words_for(FailsafeCause cause) noexcept {
  constexpr std::array words{"no cause given",
                             "its plan ran out",
                             "held too long without commands",
                             "agent is silent",
                             "the ledger is silent",
                             "its state is stale",
                             "its pose is lost",
                             "it is at the fence",
                             "battery low",
                             "battery critical",
                             "stopped",
                             "the ledger is not trusted",
                             "its own velocity is lost (it sees no ground)",
                             "its position is too uncertain for the fence",
                             "it does not move as commanded",
                             "it is tilted",
                             "it lies on its back or side",
                             "another drone is too near",
                             "its height above the ground is lost (tof sees nothing)",
                             "another client commands it as well",
                             "the sources of its position contradict each other",
                             "a check of link or agent failed (a fault of the program itself)",
                             "the drone itself refuses to take off: its own words are in link's log"};
  return name_of(cause, words, "unknown cause");
}

/// The value that has this name.
template <typename Enum>
constexpr std::optional<Enum> from_name(std::string_view text) noexcept {
  for (std::uint8_t i = 0; std::string_view(name(static_cast<Enum>(i))) != "unknown"; ++i) {
    if (text == name(static_cast<Enum>(i))) return static_cast<Enum>(i);
  }
  return std::nullopt;
}

}  // namespace ledgerline
