#include "onboard/link/core/tello/lost_link_protocol.hpp"

#include <algorithm>

namespace ledgerline::link {

void LostLinkProtocol::enter(TimeNs now, Stage stage) noexcept {
  stage_ = stage;
  stage_since_ns_ = now;
  sent_ns_ = 0;
}

void LostLinkProtocol::seek() noexcept {
  enter(0, Stage::seeks);
  handshakes_ = 0;
  command_ = Command::land;
  begin_round();
}

void LostLinkProtocol::begin_silence(TimeNs now, Command command) noexcept {
  command_ = command;
  begin_round();
  enter(now, Stage::silent);
}

void LostLinkProtocol::land(TimeNs now, Command command) noexcept {
  if (stage_ != Stage::seeks && (command == command_ || command == Command::land)) return;
  command_ = command;
  enter(now, Stage::lands);
}

void LostLinkProtocol::land_again(TimeNs now, Requester by) noexcept {
  if (by != Requester::local) {
    bool& may = by == Requester::holder ? for_holder_ : for_contract_;
    if (stage_ == Stage::seeks || !may) return;
    may = false;
    if (by == Requester::holder && stage_ == Stage::lands) return;
  }
  enter(now, Stage::lands);
}

bool LostLinkProtocol::handshakes_failed(TimeNs now) const noexcept {
  return stage_ == Stage::seeks && handshakes_ >= settings_.handshakes && now - sent_ns_ >= timeout_ns_;
}

bool LostLinkProtocol::has_sent_for(TimeNs now, TimeNs duration) const noexcept {
  return stage_ == Stage::silent || (stage_ == Stage::lands && now - stage_since_ns_ >= duration);
}

LostLinkProtocol::Due LostLinkProtocol::advance_seeking(TimeNs now, bool may_be_airborne) noexcept {
  Due due;
  const bool first = sent_ns_ == 0;
  if (first || (now - sent_ns_ >= timeout_ns_ && !(may_be_airborne && handshakes_ >= settings_.handshakes))) {
    timeout_ns_ = first ? settings_.answer_timeout_ns : std::min(2 * timeout_ns_, settings_.answer_timeout_max_ns);
    handshakes_ = std::min(handshakes_ + 1, settings_.handshakes);
    sent_ns_ = now;
    due.handshake = true;
  }
  // Without the zero it would fly on with the last command of a link that is gone.
  due.zero = due.handshake || (may_be_airborne && !handshakes_failed(now) && now - zero_ns_ >= settings_.zero_gap_ns);
  if (due.zero) zero_ns_ = now;
  return due;
}

LostLinkProtocol::Due LostLinkProtocol::advance(TimeNs now, bool may_be_airborne) noexcept {
  if (stage_ != Stage::seeks && !may_be_airborne) seek();  // seen on the ground, though no answer comes
  if (stage_ == Stage::lands && now - stage_since_ns_ >= settings_.lost_link_land_for_ns) enter(now, Stage::silent);
  if (stage_ == Stage::silent && now - stage_since_ns_ >= settings_.silence_ns) {
    begin_round();
    enter(now, Stage::lands);
  }
  if (stage_ == Stage::seeks) return advance_seeking(now, may_be_airborne);
  if (stage_ == Stage::silent || (sent_ns_ != 0 && now - sent_ns_ < settings_.lost_link_repeat_ns)) return {};
  sent_ns_ = now;
  return {true, true, true};
}

// At once: the first datagram after `command` is the zero.
bool LostLinkProtocol::next_send(TimeNs now, bool may_be_airborne, CommandText& out) noexcept {
  if (commands_.empty()) {
    const Due what = advance(now, may_be_airborne);
    if (what.handshake) commands_.push(CommandText("command"));
    if (what.zero) commands_.push(rc_text({}));
    if (what.landing) commands_.push(CommandText(command_ == Command::emergency ? "emergency" : "land"));
  }
  if (commands_.empty()) return false;
  out = commands_[0];
  commands_.erase_front(1);
  return true;
}

}  // namespace ledgerline::link
