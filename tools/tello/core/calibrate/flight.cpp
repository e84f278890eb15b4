#include "tools/tello/core/calibrate/flight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/text.hpp"

namespace ledgerline::tello {
namespace {

constexpr TimeNs again_ns = 500 * ns_per_ms;      // `command` without an answer
constexpr int max_handshakes = 10;                // 5 s
constexpr TimeNs quiet_ns = 300 * ns_per_ms;      // after the handshake: late oks of its repetitions come in
constexpr TimeNs first_pose_ns = 10 * ns_per_s;   // DDS finds its writers within a second or two
constexpr TimeNs max_takeoff_ns = 20 * ns_per_s;  // as clients wait for its answer
constexpr TimeNs rc_every_ns = 50 * ns_per_ms;    // as link's max_gap_ns: one that is lost is made good soon
constexpr TimeNs silent_ns = 1 * ns_per_s;
constexpr TimeNs landing_ns = 60 * ns_per_s;  // from 2.5 m at 0.5 m/s 5 s; the rest is for a Wi-Fi that comes back
constexpr TimeNs rising_ns = 12 * ns_per_s;   // of a take-off that is broken off at the latest
constexpr TimeNs landing_again_ns = 1 * ns_per_s;
constexpr TimeNs turn_ns = 10 * ns_per_s;  // at 35 % of the slowest of drones
constexpr double max_way_m = 2.0, max_reach_m = 0.7, max_reach_z_m = 0.35;
constexpr TimeNs min_stroke_ns = 800 * ns_per_ms;  // until then what came before may still lead it outwards
constexpr float max_tilt_deg = 35, min_height_m = 0.25F, max_height_m = 2.5F, min_battery = 0.30F;
constexpr double right_angle_deg = 75;  // of turning with rc; what it turns until it stands comes on top
constexpr std::size_t max_shown = 60;

/// A channel's strokes. Each block's are balanced, so that it ends where it began: half, -1, +1, -1, half. Values of rc
/// differ, since a drone reports its speed in whole dm/s: what is rounded off one is not off the other.
struct Strokes {
  int channel = 0;
  std::array<int, 5> rc{};
  double half_s = 0.97;  ///< no multiple of the 0.1 s between two state texts
  bool turn = false;     ///< one stroke of the first value, until it has turned by a right angle
};
constexpr std::array<int, 5> one{30, -36, 40, -38, 38}, two{36, -32, 30, -34, 36}, three{33, -38, 35, -31, 35},
    vertical{25, -32, 44, -45, 41};  // further apart: vgz has no noise that would level what is rounded
constexpr double half_up_s = 0.63;
constexpr std::array<Strokes, 8> schedule{{{forward, one},
                                           {right, two},
                                           {up, vertical, half_up_s},
                                           {clockwise, two},
                                           {clockwise, {38}, 0, true},
                                           {forward, three},
                                           {right, one},
                                           {clockwise, {-38}, 0, true}}};
constexpr double hover_s = 2.03;
// Back to within so much; a drone that drifts by 5 cm/s is 0.6 m away after a block of maximum length.
constexpr double home_m = 0.15;
constexpr TimeNs max_back_ns = 4 * ns_per_s;
constexpr double back_per_m = 60, max_back_rc = 30;
constexpr const char* channel_names[] = {"to the right", "forward", "up", "clockwise"};

std::size_t strokes_of(const Strokes& strokes) { return strokes.turn ? 1 : strokes.rc.size(); }

double stroke_s(const Strokes& strokes, std::size_t at) {
  const bool half = at == 0 || at + 1 == strokes.rc.size();
  return half ? strokes.half_s : 2 * strokes.half_s;
}

std::complex<double> in_plane(const PoseSample& pose) { return {pose.position_m[0], pose.position_m[1]}; }

const Strokes& strokes_at(std::size_t block) { return schedule[block % schedule.size()]; }

}  // namespace

void CalibrationFlight::begin(Phase phase, TimeNs now) {
  phase_ = phase;
  since_ns_ = now;
}

void CalibrationFlight::end(const std::string& why) {
  if (phase_ == Phase::landing || phase_ == Phase::over) return;
  failure_ = why;
  // What never took off needs no landing.
  begin(took_off_ ? Phase::landing : Phase::over, now_ns_);
}

void CalibrationFlight::on_answer(std::string_view bytes) {
  if (phase_ == Phase::landing) return landing_.on_answer(bytes);
  switch (link::parse_answer(bytes)) {
    case link::Answer::ok:
      answered_ = true;
      break;
    case link::Answer::refused:
      refusal_ = printable(link::without_line_end(bytes), max_shown);
      break;
    case link::Answer::unknown:
      break;
  }
}

void CalibrationFlight::on_state(TimeNs now, std::string_view bytes) {
  link::TelloState state = senses_.state;
  if (!link::parse_state(bytes, state)) return;
  const double dt = senses_.state_ns == 0 ? 0 : std::min(0.5, to_seconds(now - senses_.state_ns));
  for (std::size_t i = 0; i < 3; ++i) senses_.way_m[i] += static_cast<double>(state.velocity_dmps[i]) / 10 * dt;
  if (senses_.state_ns != 0)
    senses_.turned_deg += std::remainder(
        static_cast<double>(state.attitude_deg[2]) - static_cast<double>(senses_.state.attitude_deg[2]), 360.0);
  senses_.state = state;
  senses_.state_ns = now;
  record_.states.push_back({now, state});
  if (took_off_) landing_.on_state(now, bytes);
}

void CalibrationFlight::on_pose(const PoseSample& pose) {
  if (senses_.pose && pose.stamp_ns <= senses_.pose->stamp_ns) return;
  for (const double value : pose.position_m)
    if (!std::isfinite(value)) return;
  if (!std::isfinite(pose.yaw_rad)) return;
  senses_.pose = pose;
  record_.poses.push_back(pose);
}

// Along the plane, or up and down while that is what it does.
double CalibrationFlight::away_m() const {
  const bool vertical = phase_ == Phase::stroke && strokes_at(progress_.block).channel == up;
  if (senses_.home && senses_.pose) {
    const double z = senses_.pose->position_m[2] - senses_.home->position_m[2];
    if (vertical) return std::abs(z);
    return std::hypot(senses_.pose->position_m[0] - senses_.home->position_m[0],
                      senses_.pose->position_m[1] - senses_.home->position_m[1]);
  }
  return vertical ? std::abs(senses_.way_m[2]) : std::hypot(senses_.way_m[0], senses_.way_m[1]);
}

Status CalibrationFlight::check(TimeNs now) const {
  if (now - senses_.state_ns > silent_ns) return Error{"no state text came for a second"};
  const bool seen = senses_.pose && now - senses_.pose->stamp_ns <= silent_ns;
  if (settings_.poses && !seen && phase_ != Phase::poses) return Error{"no pose came for a second"};
  if (senses_.state.battery < min_battery)
    return Error{
        fmt::format("its battery has {:.0f} %, and {:.0f} are needed", senses_.state.battery * 100, min_battery * 100)};
  if (std::max(std::abs(senses_.state.attitude_deg[0]), std::abs(senses_.state.attitude_deg[1])) > max_tilt_deg)
    return Error{fmt::format("it tilts by more than {:.0f} degrees", max_tilt_deg)};
  if (phase_ != Phase::back && phase_ != Phase::hover && phase_ != Phase::stroke) return done;
  const float height = height_of(senses_.state);
  if (height < min_height_m || height > max_height_m) return Error{fmt::format("its height is {:.1f} m", height)};
  if (away_m() > max_way_m) return Error{fmt::format("it is {:.1f} m away from where it began", away_m())};
  return done;
}

std::vector<std::string> CalibrationFlight::pop_due(TimeNs now) {
  now_ns_ = now;
  Words words;
  if (phase_ != Phase::handshake && phase_ != Phase::landing && phase_ != Phase::over)
    if (const Status good = check(now); !good) end(good.error().message);
  switch (phase_) {
    case Phase::handshake:
      handshake(now, words);
      break;
    case Phase::poses:
      wait_for_pose(now);
      break;
    case Phase::takeoff:
      take_off(now, words);
      break;
    case Phase::back:
    case Phase::hover:
    case Phase::stroke:
      fly(now, words);
      break;
    case Phase::landing:
      land(now, words);
      break;
    case Phase::over:
      break;
  }
  return words;
}

void CalibrationFlight::handshake(TimeNs now, Words& words) {
  if (answered_ && senses_.state_ns != 0 && now - said_ns_ > quiet_ns) {
    begin(Phase::poses, now);
    return;
  }
  if (tries_ > 0 && now - said_ns_ < again_ns) return;
  if (tries_++ == max_handshakes)
    return end(answered_ ? "it answers, but sends no state text that says battery, height and tof"
                         : "it does not answer");
  said_ns_ = now;
  words.emplace_back("command");
}

// Refuses what must not take off, too: check() is asked before.
void CalibrationFlight::wait_for_pose(TimeNs now) {
  if (!senses_.state.has_velocity) return end("its state text does not report vgx, vgy and vgz");
  if (settings_.poses && (!senses_.pose || now - senses_.pose->stamp_ns > silent_ns)) {
    if (now - since_ns_ > first_pose_ns) end("no pose comes: is the topic's name right, and does the source see it?");
    return;
  }
  answered_ = false;
  refusal_.clear();
  tries_ = 0;
  begin(Phase::takeoff, now);
}

void CalibrationFlight::take_off(TimeNs now, Words& words) {
  if (tries_ == 0) {
    tries_ = 1;
    took_off_ = true;
    takeoff_ns_ = now;
    words.emplace_back("takeoff");
    return;
  }
  if (!refusal_.empty()) return end("it refuses to take off: " + refusal_);
  if (now - since_ns_ > max_takeoff_ns) return end("it did not take off within 20 s");
  if (!answered_ || !aloft_now()) return;
  senses_.way_m = {};
  senses_.home = senses_.pose;
  begin(Phase::hover, now);
}

void CalibrationFlight::set_rc(TimeNs now, int channel, int value) {
  progress_.stroke_from = senses_.pose;
  rc_ = {};
  rc_[static_cast<std::size_t>(channel)] = value;
  record_.sent_rc.push_back({now, rc_});
  said_ns_ = 0;
}

void CalibrationFlight::begin_block(TimeNs now) {
  begin(Phase::stroke, now);
  progress_.stroke = 0;
  senses_.turned_deg = 0;
  senses_.way_m[2] = 0;
  if (senses_.home) senses_.home->position_m[2] = senses_.pose->position_m[2];
  record_.blocks.push_back({strokes_at(progress_.block).channel, now, 0});
  set_rc(now, strokes_at(progress_.block).channel, strokes_at(progress_.block).rc[0]);
}

bool CalibrationFlight::stroke_ends(TimeNs now) const {
  const Strokes& strokes = strokes_at(progress_.block);
  if (strokes.turn) return std::abs(senses_.turned_deg) >= right_angle_deg;
  if (now - since_ns_ >= from_seconds(stroke_s(strokes, progress_.stroke))) return true;
  const double reach = strokes.channel == up ? max_reach_z_m : max_reach_m;
  return strokes.channel != clockwise && now - since_ns_ >= min_stroke_ns && progress_.outwards && away_m() > reach;
}

void CalibrationFlight::next_stroke(TimeNs now) {
  const Strokes& strokes = strokes_at(progress_.block);
  if (progress_.stroke_from && strokes.channel <= forward) {
    const double towards = rc_[static_cast<std::size_t>(strokes.channel)] > 0 ? 1 : -1;
    response_m_[static_cast<std::size_t>(strokes.channel)] +=
        towards * std::polar(1.0, -senses_.pose->yaw_rad) *
        (in_plane(*senses_.pose) - in_plane(*progress_.stroke_from));
  }
  begin(Phase::stroke, now);
  if (++progress_.stroke < strokes_of(strokes)) return set_rc(now, strokes.channel, strokes.rc[progress_.stroke]);
  record_.blocks.back().end_ns = now;
  set_rc(now, strokes.channel, 0);
  if (strokes.turn) senses_.way_m = {};
  ++progress_.block;
  begin(Phase::back, now);
}

link::Rc CalibrationFlight::rc_home() const {
  link::Rc rc{};
  if (!senses_.home || !senses_.pose || response_m_[right] == 0.0 || response_m_[forward] == 0.0) return rc;
  const std::complex<double> to =
      (in_plane(*senses_.home) - in_plane(*senses_.pose)) * std::polar(1.0, -senses_.pose->yaw_rad);
  if (std::abs(to) < home_m) return rc;
  for (const std::size_t channel : {right, forward}) {
    const std::complex<double> lead = response_m_[channel] / std::abs(response_m_[channel]);
    const double along_m = (to * std::conj(lead)).real();
    rc[channel] = static_cast<int>(std::lround(std::clamp(back_per_m * along_m, -max_back_rc, max_back_rc)));
  }
  return rc;
}

void CalibrationFlight::fly(TimeNs now, Words& words) {
  if (phase_ == Phase::back) {
    rc_ = now - since_ns_ < max_back_ns ? rc_home() : link::Rc{};
    if (rc_ == link::Rc{}) begin(Phase::hover, now);
  } else if (phase_ == Phase::hover && now - since_ns_ >= from_seconds(hover_s)) {
    if (progress_.block >= schedule.size() * static_cast<std::size_t>(settings_.repeat)) {
      begin(Phase::landing, now);
      return land(now, words);
    }
    begin_block(now);
  } else if (phase_ == Phase::stroke) {
    const double away = away_m();
    if (away != progress_.last_away_m) progress_.outwards = away > progress_.last_away_m;
    progress_.last_away_m = away;
    if (strokes_at(progress_.block).turn && now - since_ns_ > turn_ns)
      return end("it does not turn when rc commands it to");
    if (stroke_ends(now)) next_stroke(now);
  }
  if (now - said_ns_ < rc_every_ns) return;
  said_ns_ = now;
  words.emplace_back(link::rc_text(rc_).view());
}

void CalibrationFlight::land(TimeNs now, Words& words) {
  // A take-off ignores `land`, while its drone still stands there or is said to be up: an early report of a landing is
  // not accepted.
  if (landing_.down() && now - takeoff_ns_ < rising_ns) {
    if (now - said_ns_ < landing_again_ns) return;
    said_ns_ = now;
    landing_ = Landing();
  }
  words = landing_.pop_due(now);
  if ((landing_.down() && now - takeoff_ns_ >= rising_ns) || now - since_ns_ > landing_ns) {
    if (!landing_.down() && failure_.empty()) failure_ = "it was not seen down";
    begin(Phase::over, now);
  }
}

std::string CalibrationFlight::doing() const {
  switch (phase_) {
    case Phase::handshake:
    case Phase::poses:
      return "says hello";
    case Phase::takeoff:
      return "takes off";
    case Phase::back:
    case Phase::hover:
    case Phase::stroke:
      return fmt::format("{} of {}: {} and back",
                         std::min(progress_.block + 1, schedule.size() * static_cast<std::size_t>(settings_.repeat)),
                         schedule.size() * static_cast<std::size_t>(settings_.repeat),
                         channel_names[strokes_at(progress_.block).channel]);
    case Phase::landing:
      return "lands";
    case Phase::over:
      break;
  }
  return "is over";
}

}  // namespace ledgerline::tello
