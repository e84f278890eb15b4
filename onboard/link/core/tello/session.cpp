#include "onboard/link/core/tello/session.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "onboard/link/core/watch/held.hpp"

namespace ledgerline::link {

namespace {
// State text comes at 10 Hz; what is older than this does not decide about take-off or landing.
constexpr TimeNs fresh_for_ns = 500 * ns_per_ms;
// The drone must be seen on the ground this long before it counts as landed without an answer.
constexpr TimeNs grounded_for_ns = 1 * ns_per_s;
// Less descent than this between two `land` means that it does not come down.
constexpr float descent_m = 0.1F;
// A drone taken to be on the ground but seen aloft this long is in flight, whatever the answers said.
constexpr TimeNs aloft_for_ns = 300 * ns_per_ms;
// `time` is in whole seconds, and a text may come late: so far ahead of what is known it may be.
constexpr double motor_time_step_s = 1.2, motor_time_slack_s = 2;
// So many refused texts in a row whose `time` goes on as time does are right: what was accepted before them was not.
constexpr int refused_texts_needed = 10;
// A drone taken to be in flight but seen on the ground this long has come down by itself.
constexpr TimeNs down_for_ns = 3 * ns_per_s;

}  // namespace

void TelloSession::enter(TimeNs now, FlightPhase phase) noexcept {
  phase_ = phase;
  phase_since_ns_ = now;
  grounded_since_ns_ = aloft_since_ns_ = 0;
  if (in_flight(phase)) stands_ = false, down_since_ns_ = 0;
  if (phase == FlightPhase::flying) has_flown_ = true;
  if (phase == FlightPhase::disconnected) {
    handshake_ok_ = false;
    asked_ = PendingCommand::nothing;
    lost_link_.seek();
    serial_.begin();
  }
}

void TelloSession::ask(TimeNs now, PendingCommand what) noexcept {
  if (what == PendingCommand::emergency && asked_ != what) cut_since_ns_ = now;
  asked_ = what;
  asked_at_ns_ = now;
  send_ = true;
}

bool TelloSession::fresh(TimeNs now) const noexcept { return state_at_ns_ != 0 && now - state_at_ns_ < fresh_for_ns; }

bool TelloSession::seen_airborne(TimeNs now) const noexcept {
  return fresh(now) && state_.height_m >= settings_.airborne_m;
}

bool TelloSession::seen_grounded(TimeNs now) const noexcept {
  return fresh(now) && state_.height_m < settings_.airborne_m && state_.tof_m <= settings_.grounded_m;
}

bool TelloSession::of_now(TimeNs now, const TelloState& said) noexcept {
  if (!said.has_motor_time) return true;
  const double lead_s = said.motor_s - to_seconds(now);
  const bool follows = said.motor_s >= motor_s_ && lead_s <= motor_lead_s_ + motor_time_slack_s;
  if (follows || phase_ == FlightPhase::disconnected) {
    motor_lead_s_ = follows ? std::max(motor_lead_s_, lead_s) : lead_s;
  } else {
    refused_texts_ =
        refused_texts_ > 0 && std::abs(lead_s - refused_lead_s_) < motor_time_step_s ? refused_texts_ + 1 : 1;
    if (refused_texts_ == 1) refused_lead_s_ = lead_s;
    if (refused_texts_ < refused_texts_needed) return false;
    motor_lead_s_ = lead_s;
  }
  motor_s_ = said.motor_s;
  refused_texts_ = 0;
  return true;
}

void TelloSession::grow_older(TimeNs slept_ns) noexcept {
  motor_lead_s_ += to_seconds(slept_ns);
  refused_texts_ = 0;
}

bool TelloSession::on_state(TimeNs now, std::string_view bytes) noexcept {
  TelloState said = state_;
  if (!parse_state(bytes, said)) {
    ++states_refused_;
    return false;
  }
  if (!of_now(now, said)) return false;
  state_ = said;
  take_battery(state_.battery);
  if (!fresh(now)) down_since_ns_ = 0;  // who knows what it did meanwhile
  state_at_ns_ = now;
  heard_ = true;
  if (seen_airborne(now)) rising_until_ns_ = 0;
  // Still on the ground a moment after a take-off was sent, it may yet rise.
  const bool down = now >= rising_until_ns_ && seen_grounded(now);
  stands_ = held(now, down, down_since_ns_, settings_.stands_after_ns);
  return true;
}

void TelloSession::take_battery(float reported) noexcept {
  if (batteries_reported_.size() == SessionSettings::battery_texts) batteries_reported_.erase_front(1);
  batteries_reported_.push(reported);
  const auto needed =
      static_cast<std::ptrdiff_t>(std::min(SessionSettings::battery_says_so, batteries_reported_.size()));
  state_.battery = 1;
  for (const float low : batteries_reported_) {
    const auto says_so = [low](float battery) { return battery <= low; };
    if (std::count_if(batteries_reported_.begin(), batteries_reported_.end(), says_so) >= needed)
      state_.battery = std::min(state_.battery, low);
  }
}

// Until the state text shows that it looks for them: an answer is not needed, nor waited for.
bool TelloSession::asks_for_pads(TimeNs now) noexcept {
  constexpr TimeNs pause_ns = 2 * ns_per_s;
  constexpr int not_looking = -2;
  if (pad_requests_left_ == 0 || !seen_standing(now) || asked_ != PendingCommand::nothing || !serial_.allows_takeoff())
    return false;
  if (phase_ != FlightPhase::on_ground && phase_ != FlightPhase::landed) return false;
  if (state_.pad != not_looking) {
    pad_requests_left_ = max_pad_requests;
    return false;
  }
  if (pad_request_ns_ != 0 && now - pad_request_ns_ < pause_ns) return false;
  pad_request_ns_ = now;
  --pad_requests_left_;
  return true;
}

void TelloSession::on_answer(TimeNs now, std::string_view bytes) noexcept {
  const Answer answer = parse_answer(bytes);
  if (answer != Answer::unknown) heard_ = true;
  if (answer == Answer::ok && phase_ == FlightPhase::disconnected) {
    handshake_ok_ = true;  // whatever it answers: a Tello answers nothing before `command`
    return;
  }
  if (asked_ == PendingCommand::nothing && on_ground(phase_) && serial_.on_answer(bytes)) return;
  if (answer == Answer::unknown || asked_ == PendingCommand::nothing || send_) {
    ++answers_unasked_;
    return;
  }
  switch (asked_) {
    case PendingCommand::takeoff:
      if (answer == Answer::refused) {
        asked_ = PendingCommand::nothing;
        takeoff_not_before_ns_ = now + settings_.refused_pause_ns;
        enter(now, seen_airborne(now) ? FlightPhase::flying : FlightPhase::on_ground);
      } else if (seen_airborne(now) || !fresh(now)) {
        asked_ = PendingCommand::nothing;
        enter(now, FlightPhase::flying);
      } else {
        ++answers_unasked_;  // still seen on the ground: the answer to an earlier command
      }
      break;
    case PendingCommand::land:
      // A refusal changes nothing: the command goes out again until the drone is down. While a take-off may still lift
      // it, an ok may be the take-off's.
      if (answer == Answer::ok && !seen_airborne(now) && now >= rising_until_ns_) {
        asked_ = PendingCommand::nothing;
        enter(now, FlightPhase::landed);
      }
      break;
    case PendingCommand::emergency:
      if (answer == Answer::ok && !seen_airborne(now)) {
        asked_ = PendingCommand::nothing;
        enter(now, FlightPhase::landed);
      }
      break;
    case PendingCommand::nothing:
      break;
  }
}

bool TelloSession::request_takeoff(TimeNs now) noexcept {
  if (phase_ != FlightPhase::on_ground && phase_ != FlightPhase::landed) return false;
  // A late refusal of `mon` would be taken for the take-off's.
  if (pad_request_ns_ != 0 && now - pad_request_ns_ < settings_.answer_timeout_ns) return false;
  if (now < takeoff_not_before_ns_ || asked_ != PendingCommand::nothing || !serial_.allows_takeoff()) return false;
  ask(now, PendingCommand::takeoff);
  rising_until_ns_ = now + settings_.takeoff_timeout_ns;
  enter(now, FlightPhase::taking_off);
  return true;
}

void TelloSession::request_land(TimeNs now) noexcept {
  if (may_be_airborne()) lost_link_.land(now, LostLinkProtocol::Command::land);
  if (phase_ != FlightPhase::flying && phase_ != FlightPhase::taking_off) return;
  ask(now, PendingCommand::land);
  lowest_m_ = state_.height_m;
  enter(now, FlightPhase::landing);
}

void TelloSession::request_cut(TimeNs now) noexcept {
  if (may_be_airborne()) lost_link_.land(now, LostLinkProtocol::Command::emergency);
  if (asked_ == PendingCommand::emergency || phase_ == FlightPhase::disconnected) return;
  if (phase_ == FlightPhase::on_ground || phase_ == FlightPhase::landed) return;
  ask(now, PendingCommand::emergency);
  lowest_m_ = state_.height_m;
  grounded_since_ns_ = 0;
  if (phase_ != FlightPhase::landing) enter(now, FlightPhase::landing);
}

void TelloSession::land_again(TimeNs now, LostLinkProtocol::Requester by) noexcept {
  if (may_be_airborne()) lost_link_.land_again(now, by);
}

bool TelloSession::commanded_to_land(TimeNs now) const noexcept {
  return may_be_airborne() &&
         lost_link_.has_sent_for(now, heard_ ? settings_.blind_land_for_ns : settings_.unheard_land_for_ns);
}

void TelloSession::connect(TimeNs now) noexcept {
  const bool down = seen_grounded(now), lands = lost_link_.lands();
  const bool cut = lost_link_.command() == LostLinkProtocol::Command::emergency;
  // A link that starts again finds the drone where it is, maybe in the air. A landing is not taken back there.
  enter(now, down ? FlightPhase::on_ground : lands ? FlightPhase::landing : FlightPhase::flying);
  if (down || !lands) return;
  ask(now, cut ? PendingCommand::emergency : PendingCommand::land);
  lowest_m_ = state_.height_m;
}

void TelloSession::watch_connection(TimeNs now) noexcept {
  if (phase_ == FlightPhase::disconnected) {
    if (handshake_ok_ && fresh(now)) connect(now);
  } else if (phase_ == FlightPhase::on_ground || phase_ == FlightPhase::landed) {
    if (now - std::max(state_at_ns_, phase_since_ns_) >= settings_.lost_after_ns) enter(now, FlightPhase::disconnected);
  }
}

// In its order, and at once: the first datagram after `command` is the zero.
void TelloSession::talk_without_state(TimeNs now) noexcept {
  if (phase_ != FlightPhase::disconnected) {
    lost_link_commands_.clear();
    return;
  }
  if (!lost_link_commands_.empty()) return;
  const LostLinkProtocol::Due due = lost_link_.due(now, may_be_airborne());
  if (due.handshake) lost_link_commands_.push(command_text("command"));
  if (due.zero) lost_link_commands_.push(rc_text({}));
  if (due.landing)
    lost_link_commands_.push(
        command_text(lost_link_.command() == LostLinkProtocol::Command::emergency ? "emergency" : "land"));
}

void TelloSession::watch_takeoff(TimeNs now) noexcept {
  if (phase_ != FlightPhase::taking_off || now - phase_since_ns_ < settings_.takeoff_timeout_ns) return;
  // The answer is lost. What is seen decides; without sight it may be up, and flying is the phase that can land.
  asked_ = PendingCommand::nothing;
  enter(now, seen_grounded(now) ? FlightPhase::on_ground : FlightPhase::flying);
}

void TelloSession::watch_sight(TimeNs now) noexcept {
  if (phase_ == FlightPhase::flying) {
    if (!held(now, seen_grounded(now), grounded_since_ns_, down_for_ns)) return;
    request_land(now);  // does no harm where the sight is wrong
  } else if (phase_ == FlightPhase::on_ground || phase_ == FlightPhase::landed) {
    if (!held(now, seen_airborne(now) && state_.tof_m > settings_.grounded_m, aloft_since_ns_, aloft_for_ns)) return;
    asked_ = PendingCommand::nothing;
    enter(now, FlightPhase::flying);
  }
}

void TelloSession::watch_landing(TimeNs now) noexcept {
  if (phase_ != FlightPhase::landing) return;
  // `land` is ignored during a take-off, which begins on the ground: seen there, it may yet rise.
  if (held(now, seen_grounded(now) && now >= rising_until_ns_, grounded_since_ns_, grounded_for_ns)) {
    asked_ = PendingCommand::nothing;
    enter(now, FlightPhase::landed);
    return;
  }
  if (now - std::max(state_at_ns_, phase_since_ns_) >= settings_.landing_lost_after_ns) {
    const bool cut = asked_ == PendingCommand::emergency;
    enter(now, FlightPhase::disconnected);
    lost_link_.begin_silence(now, cut ? LostLinkProtocol::Command::emergency : LostLinkProtocol::Command::land);
    return;
  }
  if (asked_ == PendingCommand::emergency) {
    const bool falls = now - cut_since_ns_ < settings_.cut_often_for_ns;
    const TimeNs gap_ns = falls ? settings_.cut_repeat_ns : settings_.land_repeat_ns;
    if (!send_ && now - asked_at_ns_ >= gap_ns) ask(now, PendingCommand::emergency);
    return;
  }
  if (!send_ && now - asked_at_ns_ >= settings_.land_repeat_ns) {
    const bool descends = fresh(now) && state_.height_m <= lowest_m_ - descent_m;
    lowest_m_ = std::min(lowest_m_, state_.height_m);
    if (descends) {
      asked_at_ns_ = now;
    } else {
      ask(now, PendingCommand::land);
    }
  }
}

bool TelloSession::next_send(TimeNs now, CommandText& out) noexcept {
  watch_connection(now);
  watch_takeoff(now);
  watch_sight(now);
  watch_landing(now);
  talk_without_state(now);
  if (!lost_link_commands_.empty()) {
    out = lost_link_commands_[0];
    lost_link_commands_.erase_front(1);
    return true;
  }
  if (asked_ == PendingCommand::nothing && on_ground(phase_) && serial_.due(now)) {
    out = command_text("sn?");
    return true;
  }
  if (asks_for_pads(now)) {
    out = command_text("mon");
    return true;
  }
  if (asked_ == PendingCommand::nothing || !send_) return false;
  send_ = false;
  asked_at_ns_ = now;
  switch (asked_) {
    case PendingCommand::takeoff:
      out = command_text("takeoff");
      break;
    case PendingCommand::land:
      out = command_text("land");
      break;
    case PendingCommand::emergency:
      out = command_text("emergency");
      break;
    case PendingCommand::nothing:
      return false;
  }
  return true;
}

}  // namespace ledgerline::link
