#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <type_traits>
#include <vector>

#include "common/base/check.hpp"
#include "common/msg/onboard.hpp"
#include "onboard/link/core/drone_link.hpp"
#include "onboard/link/core/link_io.hpp"
#include "onboard/link/core/separation.hpp"
#include "onboard/link/core/settings.hpp"

namespace ledgerline::link {

/// All of link for up to 16 drones: who of them gets what came, whether link itself is healthy, and when states are
/// sampled. step() is meant for 1 kHz. Core: no I/O, no clock, no allocation after construction; one thread.
class LinkCore {
 public:
  /// `boot_id`: random for each start; the shell or the simulated campaign's seed provides it. `starts`: link's recent
  /// starts, including this one (persistent_state.hpp): with SessionSettings::many_starts of them the first step
  /// commands every drone to land. `local_stops`: as the link before this one left them (local_stops()).
  LinkCore(const LinkSettings& settings, std::uint64_t boot_id, int starts = 1, DroneSet local_stops = {});

  /// The outputs are valid until the next step.
  const LinkOutputs& step(TimeNs now, const LinkInputs& inputs) noexcept;

  /// Checks of the core that failed: from then on all drones land, and none takes off (FS-67).
  const CheckLog& checks() const noexcept { return checks_; }

  /// No drone is in the air, nor may one be: each was seen on the ground, or said that it landed.
  bool all_on_ground() const noexcept;
  /// The same, but for drones that nobody ever heard of.
  bool all_on_ground_or_unheard() const noexcept;
  /// All are on the ground, or were commanded to land for as long as it helps (SessionSettings): link may end.
  bool all_landed_or_commanded() const noexcept;
  /// Drones that the local stop key keeps down. They must outlast this link: the code that ends it keeps them.
  DroneSet local_stops() const noexcept;
  LinkPhase phase(DroneNumber drone) const noexcept {
    return value_of(drone, [](const DroneLink& d) { return d.session().phase(); });
  }
  FailsafeMode mode(DroneNumber drone) const noexcept { return value_of(drone, &DroneLink::mode); }
  /// The newest; its stamp is 0 where there was none.
  Pose pose(DroneNumber drone) const noexcept {
    return value_of(drone, [](const DroneLink& d) { return d.position().pose(); });
  }
  /// Link flies it to make room for another, though no plan says so.
  bool makes_room(DroneNumber drone) const noexcept { return value_of(drone, &DroneLink::makes_room); }
  TimeNs margin_ns(DroneNumber drone) const noexcept { return value_of(drone, &DroneLink::margin_ns); }
  double yaw_rad(DroneNumber drone, TimeNs now) const noexcept {
    return value_of(drone, [now](const DroneLink& d) { return d.position().yaw_rad(now); });
  }

  /// Ends all plans that still wait, so that the counters add up. After the last step.
  void finish() noexcept;
  std::vector<DroneReport> reports() const;

 private:
  const DroneLink* find(DroneNumber number) const noexcept;
  DroneLink* find(DroneNumber number) noexcept;
  /// The type's zero of a drone that is none of link's.
  template <typename Read>
  std::invoke_result_t<Read, const DroneLink&> value_of(DroneNumber number, Read read) const noexcept {
    const DroneLink* drone = find(number);
    return drone ? std::invoke(read, *drone) : std::invoke_result_t<Read, const DroneLink&>{};
  }
  void watch_health(TimeNs now, bool slept) noexcept;
  /// Where the host was suspended while its clock stood still, all that is kept is older than its stamps say, and aged
  /// here; true then.
  bool age_after_suspend(TimeNs now, TimeNs suspended_ns) noexcept;
  void dispatch(const LinkMoment& at, const LinkInputs& inputs) noexcept;
  void separate(TimeNs now, double passed_s) noexcept;
  void sample(const LinkMoment& at) noexcept;

  TimeNs period_ns_;  ///< of samples
  TimeNs health_gap_ns_, health_rest_ns_;
  std::deque<DroneLink> drones_;  ///< never grows after construction
  TimeNs heartbeat_ns_ = 0;       ///< newest heartbeat of agent
  bool stop_all_ = false;
  bool land_first_;  ///< link was started too often
  CheckLog checks_;
  bool agent_check_failed_ = false;  ///< of one of its channels: they are one process
  TimeNs last_step_ns_ = 0;
  TimeNs suspended_ns_ = 0;   ///< since the host booted, as of the last step
  TimeNs not_before_ns_ = 0;  ///< what is stamped earlier is from before it was suspended
  TimeNs unhealthy_until_ns_ = 0;
  TimeNs next_sample_ns_ = 0;
  Separation separation_;
  LinkOutputs out_;
};

}  // namespace ledgerline::link
