#pragma once
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "ground/mission/check.hpp"
#include "ground/mission/mission.hpp"

namespace ledgerline::ground::mission {

enum class RunPhase { checked, approved, taking_off, to_start, flying, done, aborted };
/// What the others do when one drone is lost: lands, is stopped, loses its lease, does not begin or gives up its path.
enum class OnLoss { hover, land, go_on };
/// What is done with drones that are found in the air by a ground that was started again.
enum class AfterRestart { hover, land, go_on };

struct RunConfig {
  int required_approvals = 1;  ///< of different signers: 1 or 2
  OnLoss on_loss = OnLoss::hover;
  AfterRestart after_restart = AfterRestart::hover;
  TimeNs takeoff_ns = 40 * ns_per_s;  ///< until a drone hovers: FlightConfig gives it 25 s, and its take-off may wait
  TimeNs order_ns = 3 * ns_per_s;  ///< until a drone does what it was commanded; FlightCore takes or refuses it at once
  /// After a restart, until FlightCore has a drone (as long as it waits for a state), and approvals are set.
  TimeNs find_ns = 30 * ns_per_s;
};

/// As read from the ledger: who signed that this digest may be flown.
struct Approval {
  crypto::IdentityName signer;
  crypto::Digest digest{};
};

struct RunEvent {
  Level level = Level::info;
  std::string drone;  ///< empty: of none
  std::string text;
};

struct RunOutputs {
  std::vector<PilotCommand> commands;  ///< for FlightCore's next step
  std::vector<RunEvent> events;
  bool changed = false;  ///< saved() changed since the last step
};

/// How far a drone of a mission is.
struct DroneProgress {
  enum class Leg { standing, rising, ready, ordered, flying, halted, ended, landing, landed, lost };
  Leg leg = Leg::standing;
  std::size_t reached = 0;   ///< waypoints
  bool landing_due = false;  ///< was not seen down yet
};
/// How far a mission is: with it, what is kept for a ground that is started again.
struct RunProgress {
  RunPhase phase = RunPhase::checked;
  bool paused = false;
  std::string why;                    ///< of an aborted one
  std::vector<DroneProgress> drones;  ///< as the mission has them
};
struct SavedRun {
  Mission mission;  ///< drones in the order of their names
  RunProgress progress;
};
/// JSON of progress alone; to be kept with the mission's canonical text, and read again. The error says what is wrong
/// with what was kept. Pure; any thread.
std::string text_of(const RunProgress& progress, const Mission& mission);
std::string text_of(const RunProgress& progress, const Mission& mission, const std::string& canonical);
Result<SavedRun> saved_run_from(std::string_view text);
inline constexpr std::size_t max_saved_bytes = max_mission_bytes + 65'536;

/// Conducts one mission: all drones take off, and when every one hovers all begin their paths in the same step.
///
///     checked --approvals--> approved --start()--> taking_off --all hover--> to_start --all at their first waypoint-->
///        flying --all at their ends--> done            (from taking_off on: end(), or a loss by its rule --> aborted)
///
/// pause() has all hover and keeps the rest of their paths, resume() has all begin the rest in the same step: so they
/// keep their distances in time. A drone that is paused by hand pauses all.
///
/// start() and resume() need approvals of this mission's own digest by as many different signers as required: those of
/// another do not count, so a changed mission must be approved again.
///
/// Kept and restored, it waits until FlightCore has found each drone that was in the air, and then goes on, hovers or
/// lands (AfterRestart). It goes on only if what was kept is approved, and waits as long for the approvals to be set as
/// for the drones; then it awaits_check(), since batteries, corridors and the fence may be others by now. Nobody takes
/// off by itself after a restart.
///
/// Deterministic; no clock; one thread.
class MissionRun {
 public:
  /// The error says what is wrong with mission (check_bounds) or settings.
  static Result<MissionRun> make(Mission mission, const RunConfig& config);

  /// What saved() gave, max_saved_bytes at most; else an error.
  static Result<MissionRun> restore(std::string_view text, const RunConfig& config);
  /// JSON: mission, phase, and how far each drone is. To be kept whenever RunOutputs::changed says so.
  std::string saved() const { return text_of(progress(), mission_, canonical_); }

  const Mission& mission() const { return mission_; }  ///< drones in the order of their names
  const crypto::Digest& digest() const { return digest_; }
  const std::string& canonical() const { return canonical_; }
  /// What is left of it: the drones that are neither lost nor at their end, each with the waypoints that it has not
  /// reached.
  Mission rest() const;
  RunPhase phase() const { return phase_; }
  bool paused() const { return paused_; }
  const std::string& why() const { return why_; }  ///< of an aborted one
  /// Taken off, and not at its end: its drones are nobody else's.
  bool active() const { return phase_ >= RunPhase::taking_off && phase_ < RunPhase::done; }
  /// Of an aborted one: a drone of it was not seen down yet.
  bool landing_due() const;
  std::size_t reached(std::size_t drone) const { return parts_[drone].reached; }  ///< waypoints

  /// Another mission in the place of this one; refused once it is started.
  Status change(Mission mission);
  /// All that the ledger has, in the place of those before.
  void set_approvals(std::span<const Approval> approvals);
  std::size_t approvals() const { return approvers_.size(); }

  /// `findings`: of check() now. The error says what is missing. What these four order is in the next step's commands.
  Status start(std::span<const Finding> findings);
  Status pause();
  Status resume();
  Status end(const std::string& why);  ///< all land
  /// After a restart its drones hover until somebody has checked rest() and says by resume_after_check() what came of
  /// it.
  bool awaits_check() const { return awaits_check_; }
  /// An error: they go on hovering until somebody resumes.
  void resume_after_check(const Status& checked);

  /// `drones`: all of the flight, in FlightConfig's order, behind FlightCore's step.
  RunOutputs step(TimeNs now, std::span<const DroneNow> drones);

 private:
  using Leg = DroneProgress::Leg;
  struct Part : DroneProgress {
    std::size_t begun_at = 0;  ///< reached, when the newest path was ordered
    TimeNs asked_ns = 0;       ///< for what the leg waits for
    TimeNs ordered_ns = 0;     ///< its path, the last time
    std::uint64_t paths = 0;   ///< DroneNow::paths before the newest order
    bool found = true;         ///< after a restart: FlightCore has it
    bool to_land = false;      ///< and was not commanded to yet
  };

  MissionRun(Mission mission, const RunConfig& config);
  RunProgress progress() const;
  Status missing_approvals() const;
  void add_event(Level level, const std::string& drone, const std::string& text) {
    events_.push_back({level, drone, text});
  }
  void mark_lost(std::size_t drone, const std::string& why);
  void hold(const std::string& why);
  void abort(const std::string& why);
  void observe(TimeNs now, std::size_t drone, const DroneNow& seen);
  void observe_rising(TimeNs now, std::size_t drone, const DroneNow& seen);
  void observe_flying(TimeNs now, std::size_t drone, const DroneNow& seen);
  void observe_end(std::size_t drone, const DroneNow& seen);
  void find(TimeNs now, std::size_t drone, const DroneNow& seen);
  bool is_recovered(TimeNs now) const;
  void recover();
  void conduct(TimeNs now, std::span<const DroneNow> drones, std::span<const std::size_t> indices);
  void order(TimeNs now, std::size_t drone, const DroneNow& seen, std::size_t index);
  void advance();
  void land_all();
  void land(std::size_t drone, const DroneNow& seen, std::size_t index);
  bool is_over(std::size_t drone) const { return parts_[drone].leg >= Leg::ended && parts_[drone].leg != Leg::landing; }
  const std::string& name(std::size_t drone) const { return mission_.drones[drone].drone; }

  Mission mission_;
  RunConfig config_;
  std::string canonical_;
  crypto::Digest digest_{};
  RunPhase phase_ = RunPhase::checked;
  bool paused_ = false;
  bool recovering_ = false;
  bool awaits_check_ = false;
  TimeNs recovering_since_ns_ = 0;
  std::string why_;
  bool approvals_read_ = false;
  std::vector<Approval> all_approvals_;
  std::set<crypto::IdentityName> approvers_;  ///< of this digest
  std::vector<Part> parts_;
  std::vector<RunEvent> events_;  ///< not reported yet
  std::vector<PilotCommand> commands_;
  std::string last_saved_state_;
};

std::string name_of(RunPhase phase);

}  // namespace ledgerline::ground::mission
