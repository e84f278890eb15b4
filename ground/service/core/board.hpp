#pragma once
#include <fmt/format.h>

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/fabric/calls/outcome.hpp"
#include "ground/core/flight_view.hpp"
#include "ground/service/core/api.hpp"

namespace ledgerline::ground::service {

struct Notice {
  std::string drone;  ///< empty: of none
  std::string text;
};
/// What may come often, said at most once a second for each drone and kind, with how many there were: a storm of it
/// must not push other events out of sight. Deterministic; one thread.
template <typename Kind>
class Notices {
 public:
  void add(const std::string& drone, const Kind& kind, std::string text) {
    Slot& slot = slots_[{drone, kind}];
    slot.text = std::move(text);
    ++slot.count;
  }
  /// What is due, which is forgotten with that.
  std::vector<Notice> pop_due(TimeNs now) {
    std::vector<Notice> due;
    for (auto it = slots_.begin(); it != slots_.end();) {
      auto& [key, slot] = *it;
      const bool waits = now < slot.next_ns;
      if (!waits && slot.count == 0) {
        it = slots_.erase(it);
        continue;
      }
      if (!waits) {
        due.push_back({key.first, slot.count == 1 ? slot.text : fmt::format("{} ({} times)", slot.text, slot.count)});
        slot.count = 0;
        slot.next_ns = now + gap_ns;
      }
      ++it;
    }
    return due;
  }

 private:
  static constexpr TimeNs gap_ns = ns_per_s;
  struct Slot {
    std::string text;         ///< of the newest
    std::uint64_t count = 0;  ///< not said yet
    TimeNs next_ns = 0;
  };
  std::map<std::pair<std::string, Kind>, Slot> slots_;  ///< by drone; those of the last second
};

/// Calls that did not get through, of each drone and kind of end. Deterministic; one thread.
class Refusals {
 public:
  /// `names`: of the drones; a refusal of any other name is of none of them.
  explicit Refusals(std::vector<std::string> names) : names_(std::move(names)) {}

  /// How a call of `function` ended; a committed one is nothing to say.
  void add(std::string_view function, const fabric::Outcome& outcome);
  /// What is due, which is forgotten with that.
  std::vector<Notice> pop_due(TimeNs now) { return notices_.pop_due(now); }

 private:
  const std::vector<std::string> names_;
  Notices<fabric::Outcome::Kind> notices_;
};

/// Makes of the flight what the station's clients are sent: its drones as JSON, and events of what changed between two
/// looks. Deterministic; one thread.
class Board {
 public:
  /// Events since the look before: phases, failsafe, lease, stops, and the flight's notes.
  std::vector<Event> update(TimeNs now, const FlightView& flights, const std::vector<std::string>& notes);
  /// An event of the station itself.
  Event make_event(TimeNs now, Level level, const std::string& drone, std::string text);
  /// Events of calls that did not get through.
  std::vector<Event> refusals(TimeNs now, Refusals& refusals);
  /// [DRONE...] of docs/station.md.
  static std::string drones(TimeNs now, const FlightView& flights);
  /// {"tello1":[[x,y,z]...]}: what each drone flies or will; nothing where no path has changed since the last one.
  std::optional<std::string> changed_paths(const FlightView& flights);
  /// {"op":"state", ...} around drones().
  static std::string state_message(TimeNs now, const FlightView& flights, const std::string& drones);

 private:
  static constexpr double uncertain_m = 0.5;  ///< three sigma of a position, where it is first warned of
  struct Before {
    GroundPhase phase = GroundPhase::waiting;
    FailsafeMode mode = FailsafeMode::none;
    FailsafeCause cause = FailsafeCause::none;
    bool reached = false, silent = false;
    std::optional<crypto::IdentityName> holder, commander;
    std::string stoppers;
    double warn_at_m = uncertain_m;  ///< three sigma of its position that is warned of next
  };
  void update(TimeNs now, const FlightView& flights, std::size_t drone, std::vector<Event>& events);
  void add(TimeNs now, Level level, const std::string& drone, std::string text, std::vector<Event>& events);

  std::vector<Before> before_;
  std::vector<std::vector<std::array<double, 3>>> paths_;  ///< as last sent
  std::uint64_t next_number_ = 1;
};

}  // namespace ledgerline::ground::service
