#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "hil/sitl/facts.hpp"

namespace ledgerline::hil {

/// What a run looks like to the checker at one moment, besides the drones.
struct Moment {
  TimeNs now = 0;
  std::span<const DroneFacts> drones;
  std::span<const WorldEvent> events;
  bool link_runs = true;  ///< alive and not stopped
  /// By drone, empty: for none: limits that say nothing now.
  struct Excuse {
    bool physical = false;  ///< it was broken or pushed: speed, height and place are not the flight's own
    bool broken = false;    ///< a fault took a part of it: it may turn over
    bool cut = false;       ///< somebody asked for its motors to be cut
    bool blind = false;     ///< its own velocity is lost: it cannot know how far it goes, but physics bounds that
    bool misled = false;    ///< what it says of its own motion may be wrong
    bool steered = false;   ///< blind, and motion capture steers it all the same
    bool spins = false;     ///< broken: its pose is older than the heading that rc is said by
    bool deaf = false;      ///< it is sent nothing, or it may not get there: it goes by what it heard last
  };
  std::span<const Excuse> excuses{};
  std::optional<TimeNs> first_fault_ns, last_fault_end_ns;
  std::span<const std::size_t> first_fault_drones{};  ///< indices of those that the first fault names; empty: all
};

/// How one run ended, for what is checked at its end.
struct Ending {
  TimeNs now = 0;
  bool over = false;  ///< by itself, not by the limit
  bool ok = false;    ///< every drone finished its path and landed
  std::string why{};
  std::vector<std::string> in_the_air{};  ///< drones
  std::vector<std::string> missing{};     ///< faults of the script that never began, in words
  std::uint64_t transactions = 0;         ///< on the ledger
  std::vector<std::string> lost{};        ///< acknowledged transactions and transitions that are not on the ledger
  std::vector<std::string> crashed{};     ///< programs that ended though nobody asked for it, in words
};

/// Limits of the always-on invariants.
struct Limits {
  double speed_mps = 2.6;  ///< link's limit of 2 m/s horizontally, 1 m/s vertically, and what wind and lag add
  double height_m = 3.6;   ///< the fence is at 3 m
  std::array<double, 2> min_m{-100, -100}, max_m{100, 100};
  std::array<double, 3> fence_min_m{-100, -100, 0}, fence_max_m{100, 100, 3};  ///< the fence itself
  double sent_mps2 = 4.4;  ///< link's limit of 4 m/s2, and what rounding adds; a brake has twice as much
};

}  // namespace ledgerline::hil
