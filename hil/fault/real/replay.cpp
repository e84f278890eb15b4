#include "hil/fault/real/replay.hpp"

#include <fmt/format.h>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/msg/names.hpp"
#include "hil/fault/run/run.hpp"
#include "hil/fault/run/schedule.hpp"
#include "hil/sitl/world_setup.hpp"

namespace ledgerline::hil {
namespace {

constexpr double in_the_air_m = 0.1;  // places lower than this say nothing about a path

/// Goes through the traces, moment by moment.
class Player {
 public:
  Player(const Script& script, const Recording& recording)
      : recording_(recording),
        begin_ns_(recording.begin_ns),
        on_path_(script.kind == FlightKind::path),
        drones_(named_drones(script.flight.drones)) {
    std::vector<bool> placed(drones_.size());
    for (const TraceRecord& r : recording.sim) {  // where each stands at first
      DroneObservation* drone = of(r);
      if (!drone || placed[r.drone - 1u]) continue;
      placed[r.drone - 1u] = true;
      for (std::size_t k = 0; k < 3; ++k) drone->truth.position_m[k] = r.v[k];
    }
    for (DroneObservation& drone : drones_) {
      drone.start_m = {drone.truth.position_m[0], drone.truth.position_m[1]};
      paths_.push_back(course_of(script.flight, drone.number, drone.start_m));
      drone.corners = corners_of(paths_.back());
      drone.laps = task_of(script.flight, drone.number).laps;
    }
  }

  /// Everything up to `t_ns`, of the recording's clock.
  void play(TimeNs t_ns) {
    events_.clear();
    for (; sim_ < recording_.sim.size() && recording_.sim[sim_].t_ns <= t_ns; ++sim_) on_truth(recording_.sim[sim_]);
    for (const TimeNs at_ns : recording_.link_restarts) {
      if (at_ns > sent_ns_ && at_ns <= t_ns)
        events_.push_back({at_ns - begin_ns_, WorldEvent::Kind::started, 0, 0, "link"});
    }
    for (; link_ < recording_.link.size() && recording_.link[link_].t_ns <= t_ns; ++link_)
      on_link(recording_.link[link_]);
    for (; ground_ < recording_.ground.size() && recording_.ground[ground_].t_ns <= t_ns; ++ground_)
      on_command(recording_.ground[ground_]);
    for (const auto& fault : recording_.faults) {
      const auto tell = [&](TimeNs at_ns, const char* what) {
        if (at_ns > sent_ns_ && at_ns <= t_ns)
          events_.push_back({at_ns - begin_ns_, WorldEvent::Kind::fault, 0, 0, fault.text + what});
      };
      tell(fault.begun_ns, " begins");
      tell(fault.ended_ns, " ends");
    }
    sent_ns_ = t_ns;
  }
  const std::vector<DroneObservation>& drones() const { return drones_; }
  const std::vector<WorldEvent>& events() const { return events_; }

 private:
  DroneObservation* of(const TraceRecord& r) {
    return r.drone >= 1 && r.drone <= drones_.size() ? &drones_[r.drone - 1u] : nullptr;
  }

  void on_truth(const TraceRecord& r) {
    DroneObservation* drone = of(r);
    if (!drone || r.kind != TraceKind::truth) return;
    const std::array<double, 3> at{r.v[0], r.v[1], r.v[2]};
    const double dt = to_seconds(r.t_ns - seen_ns_);
    seen_ns_ = r.drone == drones_.size() ? r.t_ns : seen_ns_;
    for (std::size_t k = 0; k < 3; ++k)
      drone->truth.velocity_mps[k] = dt > 1e-3 && dt < 1 ? (at[k] - drone->truth.position_m[k]) / dt : 0;
    drone->truth.position_m = at;
    drone->truth.in_flight = r.extra == 1;
    drone->truth.crashed = r.extra == 2;
    drone->truth.battery = 1;
    drone->off_path_m.reset();
    if (on_path_ ? drone->ground_phase == ground::GroundPhase::path && drone->phase == LinkPhase::flying
                 : on_course(drone->truth))
      drone->off_path_m = paths_[r.drone - 1u].distance_m({at[0], at[1]});
  }

  void on_link(const TraceRecord& r) {
    DroneObservation* drone = of(r);
    if (!drone) return;
    const std::size_t index = r.drone - 1u;
    if (r.kind == TraceKind::mode) {
      drone->phase = static_cast<LinkPhase>(r.id);
      drone->mode = static_cast<FailsafeMode>(r.extra);
      drone->cause = static_cast<FailsafeCause>(static_cast<int>(r.v[0]));
      // A landing of the failsafe is steered until there is room below it.
      if (drone->phase == LinkPhase::flying && drone->mode == FailsafeMode::land)
        drone->plan_end_ns = r.t_ns - begin_ns_ + from_seconds(link::SeparationSettings{}.landing_wait_s);
      events_.push_back({r.t_ns - begin_ns_, WorldEvent::Kind::mode, index, 0, mode_text(*drone)});
    } else if (r.kind == TraceKind::state_sampled && std::isfinite(r.v[0])) {
      drone->pose = Pose{.drone = r.drone, .stamp_ns = r.stamp_ns, .position_m = {r.v[0], r.v[1], r.v[2]}};
    } else if (r.kind == TraceKind::rc_sent) {
      if (std::any_of(std::begin(r.v), std::end(r.v), [](double stick) { return !(std::abs(stick) <= 100); }))
        events_.push_back({r.t_ns - begin_ns_, WorldEvent::Kind::bad_rc, index, 0,
                           fmt::format("rc {} {} {} {}", r.v[0], r.v[1], r.v[2], r.v[3])});
      drone->sent_mps = std::hypot(r.v[0], r.v[1], r.v[2]) / 100 * rc_full_mps;
      drone->sent_ns = r.t_ns - begin_ns_;
    } else if (r.kind == TraceKind::plan_received && !on_path_) {
      // A pilot's is in hand before its first setpoint is flown: playout smooths it, by so many us.
      const TimeNs margin_ns = r.extra * 1'000LL;
      drone->plan_end_ns = std::max(drone->plan_end_ns, r.t_ns - begin_ns_ + max_plan_ns + margin_ns);
    } else if (r.kind == TraceKind::command_applied) {
      ++drone->plans_given;
      drone->plan_end_ns = std::max(drone->plan_end_ns, r.t_ns - begin_ns_ + max_plan_ns);
      drone->sent_ns = r.t_ns - begin_ns_;
      events_.push_back(
          {r.t_ns - begin_ns_, WorldEvent::Kind::applied, index, to_seconds(r.t_ns - r.stamp_ns), {}, r.id});
    }
  }

  void on_command(const TraceRecord& r) {
    DroneObservation* drone = of(r);
    if (!drone || r.kind != TraceKind::command_made) return;
    const double length_m = paths_[r.drone - 1u].length_m();
    const bool on_path = r.v[3] > 0 && r.v[3] < drone->laps * length_m;
    drone->ground_phase = on_path ? ground::GroundPhase::path : ground::GroundPhase::waiting;
    if (on_path) drone->lap = 1 + static_cast<int>(r.v[3] / length_m);
  }

  const Recording& recording_;
  TimeNs begin_ns_, sent_ns_ = 0, seen_ns_ = 0;
  bool on_path_;  ///< else somebody's own program flies
  std::vector<DroneObservation> drones_;
  std::vector<ground::Path> paths_;
  std::vector<WorldEvent> events_;
  std::size_t link_ = 0, sim_ = 0, ground_ = 0;
};

/// When the faults of a recording began and ended, and whom they excuse.
class FaultTimes {
 public:
  FaultTimes(const Recording& recording, const std::vector<DroneObservation>& drones)
      : recording_(recording), drones_(drones), all_ended_(!recording.faults.empty()) {
    for (const auto& fault : recording.faults) {
      const TimeNs begun = fault.begun_ns - recording.begin_ns, ended = fault.ended_ns - recording.begin_ns;
      if (!first_ || begun < *first_) {
        first_ = begun;
        first_drones_.clear();
        for (std::size_t i = 0; i < drones.size(); ++i) {
          if (names(fault, i)) first_drones_.push_back(i);
        }
      }
      if (fault.ended_ns == 0) {
        all_ended_ = false;
      } else if (!last_ || ended > *last_) {
        last_ = ended;
      }
    }
  }

  std::optional<TimeNs> first_begun(TimeNs now) const { return first_ && *first_ <= now ? first_ : std::nullopt; }
  std::optional<TimeNs> last_ended(TimeNs now) const {
    return all_ended_ && last_ && *last_ <= now ? last_ : std::nullopt;
  }
  const std::vector<std::size_t>& first_drones() const { return first_drones_; }

  std::vector<Moment::Excuse> excuses(TimeNs t_ns) const {
    std::vector<Moment::Excuse> excuses(drones_.size());
    for (std::size_t i = 0; i < excuses.size(); ++i) {
      excuses[i].deaf =
          std::any_of(recording_.faults.begin(), recording_.faults.end(), [&](const Recording::Fault& fault) {
            const bool ended = fault.ended_ns != 0 && t_ns > fault.ended_ns + FaultSchedule::aftermath_ns;
            return fault.deafens && names(fault, i) && fault.begun_ns <= t_ns && !ended;
          });
    }
    return excuses;
  }

 private:
  bool names(const Recording::Fault& fault, std::size_t drone) const {
    return fault.drone.empty() || fault.drone == drones_[drone].name;
  }

  const Recording& recording_;
  const std::vector<DroneObservation>& drones_;
  std::optional<TimeNs> first_, last_;
  std::vector<std::size_t> first_drones_;
  bool all_ended_;
};

std::vector<std::string> never_begun(const Script& script, const Recording& recording) {
  std::vector<std::string> begun, missing;
  for (const auto& fault : recording.faults) begun.push_back(fault.text);
  for (const Fault& fault : script.faults) {
    if (const auto found = std::find(begun.begin(), begun.end(), fault.text); found != begun.end()) {
      begun.erase(found);
    } else if (!fault.optional) {
      missing.push_back(never_text(fault));
    }
  }
  return missing;
}

double distance_m(const TimelinePoint& p, const TimelinePoint& a, const TimelinePoint& b) {
  const auto vector = [](const TimelinePoint& of) { return Eigen::Vector3d(of.at_m[0], of.at_m[1], of.at_m[2]); };
  const Eigen::Vector3d way = vector(b) - vector(a), off = vector(p) - vector(a);
  const double share = way.squaredNorm() > 0 ? std::clamp(off.dot(way) / way.squaredNorm(), 0.0, 1.0) : 0;
  return (off - share * way).norm();
}

double farthest_m(const std::vector<TimelinePoint>& from, const std::vector<TimelinePoint>& to) {
  double farthest = 0;
  for (const TimelinePoint& p : from) {
    if (p.at_m[2] < in_the_air_m) continue;
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 1; i < to.size(); ++i) nearest = std::min(nearest, distance_m(p, to[i - 1], to[i]));
    farthest = std::max(farthest, nearest);
  }
  return farthest;
}

/// From take-off until it has landed: before and behind it the two begin and end in their own ways.
std::vector<std::string> transitions_of(const RunResult& run, std::size_t drone) {
  std::vector<std::string> texts;
  for (const WorldEvent& event : run.events) {
    if (event.kind != WorldEvent::Kind::mode || event.drone != drone) continue;
    if (texts.empty() && !event.text.starts_with(name(LinkPhase::taking_off))) continue;
    if (texts.empty() || texts.back() != event.text) texts.push_back(event.text);
    if (event.text.starts_with(name(LinkPhase::landed))) break;
  }
  return texts;
}

}  // namespace

RunResult check_recording(const Script& script, std::uint64_t seed, const Recording& recording) {
  Player player(script, recording);
  RunRecorder recorder(script, seed, player.drones());
  const FaultTimes times(recording, player.drones());
  for (TimeNs now = 0; now <= recording.end_ns - recording.begin_ns; now += ns_per_ms) {
    const TimeNs t_ns = recording.begin_ns + now;
    player.play(t_ns);
    const bool away =
        !recording.has_link || std::any_of(recording.link_away.begin(), recording.link_away.end(),
                                           [&](const auto& span) { return span.first <= t_ns && t_ns < span.second; });
    const auto excuses = times.excuses(t_ns);
    recorder.observe({.now = now,
                      .drones = player.drones(),
                      .events = player.events(),
                      .link_runs = !away,
                      .excuses = excuses,
                      .first_fault_ns = times.first_begun(now),
                      .last_fault_end_ns = times.last_ended(now),
                      .first_fault_drones = times.first_drones()});
  }
  Ending ending;
  ending.now = recording.end_ns - recording.begin_ns;
  ending.over = recording.over;
  ending.ok = recording.ok;
  ending.why = recording.why;
  ending.in_the_air = in_the_air(player.drones());
  ending.missing = never_begun(script, recording);
  ending.lost = recording.lost;
  ending.crashed = recording.crashed;
  ending.evidence = recording.has_link ? Evidence::traces : Evidence::truth;
  ending.lost_is_known = recording.lost_is_known;
  RunResult result = recorder.finish(ending);
  if (!recording.has_link) return result;
  result.not_checked = {
      "that each plan's own end is followed by a hold: it is checked 2.05 s behind the newest command",
      "that agent hands each command on once and in order: link's own order is checked",
      "that no plan that waited during a brake is flown behind it: that of the plan in hand alone"};
  if (recording.lost_is_known)
    result.not_checked.emplace_back("commits that were acknowledged: the failsafe's transitions alone are looked for");
  return result;
}

Agreement compare(const RunResult& a, const RunResult& b) {
  Agreement agreement;
  for (std::size_t i = 0; i < std::min(a.timeline.size(), b.timeline.size()); ++i) {
    agreement.farthest_m = std::max(
        {agreement.farthest_m, farthest_m(a.timeline[i], b.timeline[i]), farthest_m(b.timeline[i], a.timeline[i])});
    const auto of_a = transitions_of(a, i), of_b = transitions_of(b, i);
    const auto [x, y] = std::mismatch(of_a.begin(), of_a.end(), of_b.begin(), of_b.end());
    if (x == of_a.end() && y == of_b.end()) continue;
    if (!std::exchange(agreement.same_transitions, false)) continue;
    agreement.difference = fmt::format("{}: after \"{}\" the one has \"{}\", the other \"{}\"", a.drones[i],
                                       x == of_a.begin() ? "" : *std::prev(x), x == of_a.end() ? "nothing" : *x,
                                       y == of_b.end() ? "nothing" : *y);
  }
  return agreement;
}

Verdict verdict_on(const Agreement& agreement, double within_m, TimeNs at_ns) {
  Verdict verdict = always("agrees with its simulated run");
  if (!agreement.same_transitions || agreement.farthest_m > within_m)
    verdict.broke(at_ns, fmt::format("{} transitions, places within {:.3f} m ({:.1f} m may be); {}",
                                     agreement.same_transitions ? "the same" : "other", agreement.farthest_m, within_m,
                                     agreement.difference));
  return verdict;
}

}  // namespace ledgerline::hil
