#include "onboard/link/core/tello/session.hpp"

#include <algorithm>

#include "common/base/check.hpp"
#include "common/msg/names.hpp"
#include "common/rt/since.hpp"

namespace ledgerline::link {
namespace {

// The drone must be seen on the ground this long before it counts as landed without an answer.
constexpr TimeNs grounded_for_ns = 1 * ns_per_s;
// A drone taken to be on the ground but seen aloft this long is in flight, whatever the answers said.
constexpr TimeNs aloft_for_ns = 300 * ns_per_ms;
// A drone taken to be in flight but seen on the ground this long has come down by itself.
constexpr TimeNs down_for_ns = 3 * ns_per_s;
// Less descent than this between two `land` means that it does not come down.
constexpr float descent_m = 0.1F;

}  // namespace

void TelloSession::enter(TimeNs now, LinkPhase phase) noexcept {
  phase_ = phase;
  phase_since_ns_ = now;
  grounded_since_ns_ = aloft_since_ns_ = 0;
  if (is_in_flight(phase)) stands_ = false, down_since_ns_ = 0;
  if (phase == LinkPhase::flying) {
    has_flown_ = true;
    takeoff_refusal_ = {};
  }
  if (phase == LinkPhase::disconnected) {
    handshake_ok_ = false;
    pending_.end();
    lost_link_.seek();
    serial_.begin();
  }
}

void TelloSession::end_command(TimeNs now, LinkPhase phase) noexcept {
  pending_.end();
  enter(now, phase);
}

bool TelloSession::on_state(TimeNs now, std::string_view bytes) noexcept {
  const bool was_fresh = reported_.is_fresh(now);
  if (!reported_.on_text(now, bytes, phase_ != LinkPhase::disconnected)) return false;
  if (!was_fresh) down_since_ns_ = 0;  // who knows what it did meanwhile
  heard_ = true;
  if (reported_.is_airborne(now)) rising_until_ns_ = 0;
  // Still on the ground a moment after a take-off was sent, it may yet rise.
  const bool down = now >= rising_until_ns_ && reported_.is_grounded(now);
  stands_ = has_lasted(now, down, down_since_ns_, settings_.stands_after_ns);
  return true;
}

bool TelloSession::request_pads_if_due(TimeNs now) noexcept {
  const bool stands = phase_ == LinkPhase::on_ground || phase_ == LinkPhase::landed;
  return stands && is_standing(now) && !pending_.is_pending() && serial_.allows_takeoff() &&
         pads_.request_if_due(now, state().pad);
}

void TelloSession::on_answer(TimeNs now, std::string_view bytes) noexcept {
  const Answer answer = parse_answer(bytes);
  if (answer != Answer::unknown) heard_ = true;
  if (answer == Answer::ok && phase_ == LinkPhase::disconnected) {
    handshake_ok_ = true;  // whatever it answers: a Tello answers nothing before `command`
    return;
  }
  if (!pending_.is_pending() && is_on_ground(phase_) && serial_.on_answer(bytes)) return;
  if (answer == Answer::unknown || !pending_.awaits_answer()) {
    ++answers_unasked_;
    return;
  }
  switch (pending_.kind()) {
    case PendingCommand::Kind::takeoff:
      if (answer == Answer::refused) {
        takeoff_not_before_ns_ = now + settings_.refused_pause_ns;
        takeoff_refusal_ = {now, Quote(without_line_end(bytes))};
        end_command(now, reported_.is_airborne(now) ? LinkPhase::flying : LinkPhase::on_ground);
      } else if (reported_.is_airborne(now) || !reported_.is_fresh(now)) {
        end_command(now, LinkPhase::flying);
      } else {
        ++answers_unasked_;  // still seen on the ground: the answer to an earlier command
      }
      break;
    case PendingCommand::Kind::land:
      if (now < rising_until_ns_) break;  // while a take-off may still lift it, an ok may be the take-off's
      [[fallthrough]];
    case PendingCommand::Kind::emergency:
      // A refusal changes nothing: the command goes out again until the drone is down.
      if (answer == Answer::ok && !reported_.is_airborne(now)) end_command(now, LinkPhase::landed);
      break;
    case PendingCommand::Kind::nothing:
      break;
  }
}

bool TelloSession::request_takeoff(TimeNs now) noexcept {
  if (phase_ != LinkPhase::on_ground && phase_ != LinkPhase::landed) return false;
  // A late refusal of `mon` would be taken for the take-off's.
  if (pads_.may_be_answered(now, settings_.answer_timeout_ns)) return false;
  if (now < takeoff_not_before_ns_ || pending_.is_pending() || !serial_.allows_takeoff()) return false;
  begin(now, PendingCommand::Kind::takeoff);
  rising_until_ns_ = now + settings_.takeoff_timeout_ns;
  enter(now, LinkPhase::taking_off);
  return true;
}

void TelloSession::request_land(TimeNs now) noexcept {
  if (may_be_airborne()) lost_link_.land(now, LostLinkProtocol::Command::land);
  if (phase_ != LinkPhase::flying && phase_ != LinkPhase::taking_off) return;
  begin(now, PendingCommand::Kind::land);
  enter(now, LinkPhase::landing);
}

void TelloSession::request_cut(TimeNs now) noexcept {
  if (may_be_airborne()) lost_link_.land(now, LostLinkProtocol::Command::emergency);
  if (pending_.kind() == PendingCommand::Kind::emergency || phase_ == LinkPhase::disconnected) return;
  if (phase_ == LinkPhase::on_ground || phase_ == LinkPhase::landed) return;
  begin(now, PendingCommand::Kind::emergency);
  grounded_since_ns_ = 0;
  if (phase_ != LinkPhase::landing) enter(now, LinkPhase::landing);
}

void TelloSession::land_again(TimeNs now, LostLinkProtocol::Requester by) noexcept {
  if (may_be_airborne()) lost_link_.land_again(now, by);
}

bool TelloSession::commanded_to_land(TimeNs now) const noexcept {
  return may_be_airborne() &&
         lost_link_.has_sent_for(now, heard_ ? settings_.lost_link_land_for_ns : settings_.unheard_land_for_ns);
}

void TelloSession::connect(TimeNs now) noexcept {
  const bool down = reported_.is_grounded(now), lands = lost_link_.lands();
  const bool cut = lost_link_.command() == LostLinkProtocol::Command::emergency;
  // A link that starts again finds the drone where it is, maybe in the air. A landing is not taken back there.
  enter(now, down ? LinkPhase::on_ground : lands ? LinkPhase::landing : LinkPhase::flying);
  if (down || !lands) return;
  begin(now, cut ? PendingCommand::Kind::emergency : PendingCommand::Kind::land);
}

void TelloSession::watch_connection(TimeNs now) noexcept {
  if (phase_ == LinkPhase::disconnected) {
    if (handshake_ok_ && reported_.is_fresh(now)) connect(now);
  } else if (phase_ == LinkPhase::on_ground || phase_ == LinkPhase::landed) {
    if (now - std::max(reported_.at_ns(), phase_since_ns_) >= settings_.lost_after_ns)
      enter(now, LinkPhase::disconnected);
  }
}

void TelloSession::watch_takeoff(TimeNs now) noexcept {
  if (phase_ != LinkPhase::taking_off || now - phase_since_ns_ < settings_.takeoff_timeout_ns) return;
  // The answer is lost. What is seen decides; without sight it may be up, and flying is the phase that can land.
  end_command(now, reported_.is_grounded(now) ? LinkPhase::on_ground : LinkPhase::flying);
}

void TelloSession::watch_sight(TimeNs now) noexcept {
  if (phase_ == LinkPhase::flying) {
    if (!has_lasted(now, reported_.is_grounded(now), grounded_since_ns_, down_for_ns)) return;
    request_land(now);  // does no harm where the sight is wrong
  } else if (phase_ == LinkPhase::on_ground || phase_ == LinkPhase::landed) {
    if (!has_lasted(now, reported_.is_airborne(now) && state().tof_m > settings_.grounded_m, aloft_since_ns_,
                    aloft_for_ns))
      return;
    end_command(now, LinkPhase::flying);
  }
}

void TelloSession::watch_landing(TimeNs now) noexcept {
  if (phase_ != LinkPhase::landing) return;
  // `land` is ignored during a take-off, which begins on the ground: seen there, it may yet rise.
  if (has_lasted(now, reported_.is_grounded(now) && now >= rising_until_ns_, grounded_since_ns_, grounded_for_ns)) {
    end_command(now, LinkPhase::landed);
    return;
  }
  if (now - std::max(reported_.at_ns(), phase_since_ns_) >= settings_.landing_lost_after_ns) {
    const bool cut = pending_.kind() == PendingCommand::Kind::emergency;
    enter(now, LinkPhase::disconnected);
    lost_link_.begin_silence(now, cut ? LostLinkProtocol::Command::emergency : LostLinkProtocol::Command::land);
    return;
  }
  pending_.repeat(now, reported_.is_fresh(now), state().height_m);
}

bool TelloSession::next_send(TimeNs now, CommandText& out) noexcept {
  watch_connection(now);
  watch_takeoff(now);
  watch_sight(now);
  watch_landing(now);
  const bool rises = pending_.kind() == PendingCommand::Kind::takeoff;
  LEDGERLINE_CHECK(!pending_.is_pending() || phase_ == (rises ? LinkPhase::taking_off : LinkPhase::landing),
                   "a pending command is of its phase", name(phase_));
  if (phase_ == LinkPhase::disconnected) {
    if (lost_link_.next_send(now, may_be_airborne(), out)) return true;
  } else {
    lost_link_.drop_commands();
  }
  if (!pending_.is_pending() && is_on_ground(phase_) && serial_.request_if_due(now)) {
    out = CommandText("sn?");
    return true;
  }
  if (request_pads_if_due(now)) {
    out = CommandText("mon");
    return true;
  }
  return pending_.next_send(now, out);
}

void PendingCommand::begin(TimeNs now, Kind kind, float height_m) noexcept {
  if (kind == Kind::emergency) cut_since_ns_ = now;
  kind_ = kind;
  at_ns_ = now;
  must_send_ = true;
  lowest_m_ = height_m;
}

void PendingCommand::repeat(TimeNs now, bool is_fresh, float height_m) noexcept {
  const bool falls = kind_ == Kind::emergency && now - cut_since_ns_ < settings_.cut_often_for_ns;
  const TimeNs gap_ns = falls ? settings_.cut_repeat_ns : settings_.land_repeat_ns;
  if (must_send_ || now - at_ns_ < gap_ns) return;
  const bool descends = kind_ == Kind::land && is_fresh && height_m <= lowest_m_ - descent_m;
  lowest_m_ = std::min(lowest_m_, height_m);
  at_ns_ = now;
  must_send_ = !descends;
}

bool PendingCommand::next_send(TimeNs now, CommandText& out) noexcept {
  if (!is_pending() || !must_send_) return false;
  must_send_ = false;
  at_ns_ = now;
  out = CommandText(kind_ == Kind::takeoff ? "takeoff" : kind_ == Kind::land ? "land" : "emergency");
  return true;
}

bool PadRequest::request_if_due(TimeNs now, int pad) noexcept {
  constexpr TimeNs pause_ns = 2 * ns_per_s;
  constexpr int not_looking = -2;
  if (left_ == 0) return false;
  if (pad != not_looking) {
    left_ = max_requests;
    return false;
  }
  if (requested_ns_ != 0 && now - requested_ns_ < pause_ns) return false;
  requested_ns_ = now;
  --left_;
  return true;
}

}  // namespace ledgerline::link
