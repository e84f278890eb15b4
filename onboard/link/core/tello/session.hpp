#pragma once
#include <cstdint>
#include <string_view>

#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/lost_link_protocol.hpp"
#include "onboard/link/core/tello/reported_state.hpp"
#include "onboard/link/core/tello/serial_check.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// The one command to a connected drone that waits for its answer, or is repeated until the drone is down. One thread.
class PendingCommand {
 public:
  enum class Kind : std::uint8_t { nothing, takeoff, land, emergency };

  explicit PendingCommand(const SessionSettings& settings) noexcept : settings_(settings) {}

  /// In place of what was pending. `height_m`: the drone's now.
  void begin(TimeNs now, Kind kind, float height_m) noexcept;
  void end() noexcept { kind_ = Kind::nothing; }
  Kind kind() const noexcept { return kind_; }
  bool is_pending() const noexcept { return kind_ != Kind::nothing; }
  /// It was sent, so that an answer may be to it.
  bool awaits_answer() const noexcept { return is_pending() && !must_send_; }

  /// At every step of a landing: sent again while it does not come down, `emergency` always. `is_fresh`: its height is.
  void repeat(TimeNs now, bool is_fresh, float height_m) noexcept;
  /// True when it is to be sent now.
  bool next_send(TimeNs now, CommandText& out) noexcept;

 private:
  SessionSettings settings_;
  Kind kind_ = Kind::nothing;
  bool must_send_ = false;
  TimeNs at_ns_ = 0;         ///< asked for, or sent
  TimeNs cut_since_ns_ = 0;  ///< `emergency` was asked for first
  float lowest_m_ = 0;       ///< since the last `land` was sent
};

/// When `mon`, which makes a drone look for mission pads, is sent: until the state text shows that it looks, since an
/// answer is not needed. Core: no I/O, no allocation; one thread.
class PadRequest {
 public:
  explicit PadRequest(bool wanted) noexcept : left_(wanted ? max_requests : 0) {}

  /// True: it is to be sent now, and counts as sent. For a drone that stands and owes no answer. `pad`: of the newest
  /// state text.
  bool request_if_due(TimeNs now, int pad) noexcept;
  /// Its late refusal would be taken for another command's.
  bool may_be_answered(TimeNs now, TimeNs timeout_ns) const noexcept {
    return requested_ns_ != 0 && now - requested_ns_ < timeout_ns;
  }

 private:
  /// With firmware that knows no pads TelloState::pad stays -2, as if it did not look.
  static constexpr int max_requests = 5;

  int left_;
  TimeNs requested_ns_ = 0;  ///< the newest; 0: none yet
};

/// One drone as an SDK client sees it: who may be asked what, and where the flight is.
///
///              `command` ok + state text        takeoff          ok, or it is up
///   disconnected ─────────────────▶ on_ground ─────────▶ taking_off ─────────▶ flying
///        ▲  state text shows it in the air: ──────────────────────────────────▶ │
///        │                          refused, timed out: back to on_ground       │ land
///        └── silent on the ground ── landed ◀── ok and down, or seen down ── landing
///
/// Answers carry no id and may be lost, doubled or late, so an answer alone never moves the state while fresh state
/// text says otherwise: an `ok` counts as take-off only when the drone is seen in the air. `land` is repeated until it
/// is down. `disconnected` says nothing about where the drone is: until it was seen on the ground it may fly, and is
/// spoken to as lost_link_protocol.hpp says. Core: no I/O, no allocation; one thread.
class TelloSession {
 public:
  /// `serial`: one that answers with another does not take off; empty: any. `pads`: it is to look for mission pads.
  explicit TelloSession(const SessionSettings& settings, std::string_view serial = {}, bool pads = false) noexcept
      : settings_(settings),
        reported_(settings),
        lost_link_(settings),
        pending_(settings),
        serial_(serial),
        pads_(pads) {}

  void on_answer(TimeNs now, std::string_view bytes) noexcept;
  /// False where it is no state text, or once connected one of another moment or of another drone (ReportedState).
  bool on_state(TimeNs now, std::string_view bytes) noexcept;

  /// The host was suspended for so long while its clock stood still.
  void grow_older(TimeNs slept_ns) noexcept { reported_.grow_older(slept_ns); }

  /// False when the phase, the pause after a refusal or the serial does not allow it.
  bool request_takeoff(TimeNs now) noexcept;
  /// In the air, and where it may be in the air. May be called at every step: a landing in progress continues.
  void request_land(TimeNs now) noexcept;
  /// Motors off at once, wherever it is. The same.
  void request_cut(TimeNs now) noexcept;
  /// Requested again: to a drone without state the command is sent again although it was before.
  void land_again(TimeNs now, LostLinkProtocol::Requester by) noexcept;

  /// What is to be sent now, one command at a time; called until it returns false.
  bool next_send(TimeNs now, CommandText& out) noexcept;

  LinkPhase phase() const noexcept { return phase_; }
  /// It is not connected, and was not seen standing on the ground last. So it is from link's start.
  bool may_be_airborne() const noexcept { return phase_ == LinkPhase::disconnected && !stands_; }
  /// It is in the air, or nobody knows that it is not.
  bool is_possibly_in_flight() const noexcept { return is_in_flight(phase_) || may_be_airborne(); }
  /// It may be airborne, and all handshakes failed, or it is already commanded to land.
  bool has_lost_contact(TimeNs now) const noexcept {
    return may_be_airborne() && (lost_link_.handshakes_failed(now) || lost_link_.lands());
  }
  /// It may be airborne, and `land` was sent long enough for link to exit; a shorter time if the drone never answered.
  bool commanded_to_land(TimeNs now) const noexcept;
  /// Anything that can be read came from it.
  bool has_responded() const noexcept { return heard_; }
  /// It is not in flight, and the newest text shows it on the ground.
  bool is_standing(TimeNs now) const noexcept { return !is_in_flight(phase_) && reported_.is_grounded(now); }
  TimeNs phase_since_ns() const noexcept { return phase_since_ns_; }
  const TelloState& state() const noexcept { return reported_.newest(); }
  const SerialCheck& serial() const noexcept { return serial_; }
  /// When the newest state text came; 0: none yet.
  TimeNs state_at_ns() const noexcept { return reported_.at_ns(); }
  bool has_flown() const noexcept { return has_flown_; }
  /// The drone's own words to the newest take-off that it refused on the ground; forgotten when one is accepted.
  const DroneText& takeoff_refusal() const noexcept { return takeoff_refusal_; }
  /// What comes in place of state texts (ReportedState).
  const DroneText& unreadable_text() const noexcept { return reported_.unreadable_text(); }
  std::uint32_t states_refused() const noexcept { return reported_.unreadable(); }
  std::uint32_t answers_unasked() const noexcept { return answers_unasked_; }

 private:
  void enter(TimeNs now, LinkPhase phase) noexcept;
  void begin(TimeNs now, PendingCommand::Kind kind) noexcept { pending_.begin(now, kind, state().height_m); }
  void end_command(TimeNs now, LinkPhase phase) noexcept;
  void watch_connection(TimeNs now) noexcept;
  void watch_takeoff(TimeNs now) noexcept;
  void watch_sight(TimeNs now) noexcept;
  void watch_landing(TimeNs now) noexcept;
  void connect(TimeNs now) noexcept;
  bool request_pads_if_due(TimeNs now) noexcept;

  SessionSettings settings_;
  ReportedState reported_;
  LostLinkProtocol lost_link_;
  PendingCommand pending_;
  SerialCheck serial_;
  PadRequest pads_;
  LinkPhase phase_ = LinkPhase::disconnected;
  TimeNs phase_since_ns_ = 0;
  bool heard_ = false;
  bool stands_ = false;  ///< on the ground, by what was seen last, and for long enough to accept it
  bool handshake_ok_ = false;
  bool has_flown_ = false;
  TimeNs takeoff_not_before_ns_ = 0;
  DroneText takeoff_refusal_;
  TimeNs rising_until_ns_ = 0;  ///< until then a take-off that was sent may still lift it; 0: seen in the air since
  TimeNs grounded_since_ns_ = 0, aloft_since_ns_ = 0, down_since_ns_ = 0;
  std::uint32_t answers_unasked_ = 0;
};

}  // namespace ledgerline::link
