#pragma once
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "common/msg/onboard.hpp"
#include "common/rt/histogram.hpp"
#include "common/rt/trace.hpp"
#include "onboard/link/core/failsafe.hpp"
#include "onboard/link/core/fixed_vector.hpp"
#include "onboard/link/core/playout/playout.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/session.hpp"
#include "onboard/link/core/transition_log.hpp"

namespace ledgerline::link {

/// The two ports of a drone that link hears: answers (8889) and state text (8890).
enum class Port : std::uint8_t { answer, state };

struct Received {
  DroneNumber drone = 0;
  Port port = Port::answer;
  std::string_view bytes;
};

/// For the drone's port 8889.
struct ToSend {
  DroneNumber drone = 0;
  CommandText command;
};

/// What came since the last step, in the order it came.
struct LinkInputs {
  std::span<const Received> received;
  std::span<const Plan> plans;
  std::span<const Pose> poses;
  std::span<const AgentBeat> beats;
  bool stop_all = false;  ///< the local stop key (SIGTERM): every drone lands; stays true once it was
};

struct LinkOutputs {
  FixedVector<ToSend, 4 * max_drones> to_send;
  FixedVector<StateSample, max_drones> states;
  FixedVector<Transition, max_drones> transitions;  ///< what is lost on the way comes again
  FixedVector<TraceRecord, 512> trace;
};

/// Figures of one drone since the start.
struct DroneReport {
  std::string name;
  DroneNumber number = 0;
  std::uint64_t states_sampled = 0;
  PlanCounters plans;
  TransitionLog::Counters transitions;
  Quantiles age_ms;     ///< at application: sent - the state's stamp
  bool heard = false;   ///< anything at all came from it
  bool landed = false;  ///< it flew and is on the ground again
  FlightPhase phase = FlightPhase::disconnected;
};

/// All of link for up to 16 drones: sessions, playout, limits, failsafe. `step` is meant for 1 kHz and works at any
/// rate. Core: no I/O, no clock, no allocation after construction; one thread.
class LinkCore {
 public:
  /// `boot_id`: random for each start; the shell or the virtual campaign's seed provides it. `starts`: of link of late,
  /// this one counted (starts.hpp): with SessionSettings::many_starts of them the first step tells every drone to land.
  LinkCore(const LinkSettings& settings, std::uint64_t boot_id, int starts = 1);

  /// The outputs are valid until the next step.
  const LinkOutputs& step(TimeNs now, const LinkInputs& inputs) noexcept;

  /// No drone is in the air, nor may one be: each was seen on the ground, or said that it landed.
  bool all_on_ground() const noexcept;
  /// The same, but for drones that nobody ever heard of.
  bool all_on_ground_or_unheard() const noexcept;
  /// All are on the ground, or were told to land for as long as it helps (SessionSettings): link may end.
  bool all_landed_or_told() const noexcept;
  FlightPhase phase(DroneNumber drone) const noexcept;
  FailsafeMode mode(DroneNumber drone) const noexcept;
  /// How much later than they say its setpoints are flown now.
  TimeNs margin_ns(DroneNumber drone) const noexcept;

  /// Ends all plans that still wait, so that the counters add up. After the last step.
  void finish() noexcept;
  std::vector<DroneReport> reports() const;

 private:
  struct Drone {
    Drone(const DroneSettings& drone, const LinkSettings& settings)
        : name(drone.name),
          number(drone.number),
          session(settings.session),
          playout(settings.playout),
          limiter(settings.playout) {}
    std::string name;
    DroneNumber number;
    TelloSession session;
    Playout playout;
    Limiter limiter;
    FailsafeState failsafe;
    FailsafeFacts facts;
    TransitionLog transitions;
    Transition last_transition;
    Pose pose;
    std::array<double, 3> moved_m{};  ///< since that pose, as far as what was sent tells
    bool stop = false;                ///< until the next take-off from a state after the landing
    bool cut = false;
    TimeNs takeoff_after_ns = 0;  ///< end of the last flight, or a stop: take-off wants a younger state
    FlightPhase last_phase = FlightPhase::disconnected;
    FailsafeMode last_mode = FailsafeMode::none;
    FailsafeCause last_cause = FailsafeCause::none;
    TimeNs last_rc_ns = 0;
    Rc last_rc{};
    Velocity sent;  ///< as the drone was told, after limits, failsafe and rc's range
    std::uint64_t states_sampled = 0;
    std::uint64_t applied_sequence = 0;
    TimeNs applied_stamp_ns = 0;
    TimeNs applied_late_ns = 0;
    std::uint64_t arrived_sequence = 0;
    TimeNs arrived_ns = 0;
    Histogram age;
  };

  Drone* find(DroneNumber number) noexcept;
  const Drone* find(DroneNumber number) const noexcept;
  void take_inputs(TimeNs now, const LinkInputs& inputs) noexcept;
  void take_beat(const AgentBeat& beat) noexcept;
  void take_pose(TimeNs now, const Pose& pose) noexcept;
  void dead_reckon(double seconds) noexcept;
  void take_plan(TimeNs now, const Plan& plan) noexcept;
  void take_off(TimeNs now, Drone& drone, const Plan& plan) noexcept;
  void land(TimeNs now, Drone& drone, const Plan& plan) noexcept;
  void step_drone(TimeNs now, Drone& drone) noexcept;
  void update_facts(Drone& drone, const Playout::Wish& wish) const noexcept;
  void obey_failsafe(TimeNs now, Drone& drone) noexcept;
  void talk(TimeNs now, Drone& drone) noexcept;
  void fly(TimeNs now, Drone& drone, const Playout::Wish& wish) noexcept;
  void send_rc(TimeNs now, Drone& drone, const Velocity& told, const Rc& rc) noexcept;
  void watch_phase(TimeNs now, Drone& drone) noexcept;
  void record_transition(TimeNs now, Drone& drone) noexcept;
  void sample(TimeNs now, Drone& drone) noexcept;
  void record_applied(TimeNs now, const Drone& drone, std::uint64_t sequence, TimeNs state_stamp_ns,
                      TimeNs late_ns = 0) noexcept;
  void record_ends(TimeNs now, Drone& drone) noexcept;
  bool healthy(TimeNs now) const noexcept { return now >= unhealthy_until_ns_; }

  LinkSettings settings_;
  std::uint64_t boot_id_;
  std::vector<Drone> drones_;  ///< never grows after construction
  AgentBeat beat_;
  bool stop_all_ = false;
  bool land_first_;  ///< link was started too often
  TimeNs last_step_ns_ = 0;
  TimeNs unhealthy_until_ns_ = 0;
  TimeNs next_sample_ns_ = 0;
  LinkOutputs out_;
};

}  // namespace ledgerline::link
