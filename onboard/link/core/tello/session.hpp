#pragma once
#include <cstdint>
#include <string_view>

#include "onboard/link/core/fixed_vector.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/lost_link_protocol.hpp"
#include "onboard/link/core/tello/serial_check.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// What a drone said, and when; 0: never.
struct DroneText {
  TimeNs at_ns = 0;
  Quote text;
};

/// What a drone's state texts report of it, and whether that is of now. A text of another moment or of another drone is
/// refused, by `time`, which grows as time does while the motors run. Core: no I/O, no allocation; one thread.
class ReportedState {
 public:
  explicit ReportedState(const SessionSettings& settings) noexcept
      : airborne_m_(settings.airborne_m), grounded_m_(settings.grounded_m) {}

  /// False where it is no state text, or is refused. `connected`: else any `time` may come.
  bool on_text(TimeNs now, std::string_view bytes, bool connected) noexcept;
  /// The host was suspended for so long while its clock stood still.
  void grow_older(TimeNs slept_ns) noexcept;

  /// Its battery is as low as battery_says_so of the newest battery_texts texts say, or the first one alone.
  const TelloState& newest() const noexcept { return newest_; }
  /// When the newest text came; 0: none yet.
  TimeNs at_ns() const noexcept { return at_ns_; }
  /// Young enough to decide about take-off and landing, and what it shows then.
  bool is_fresh(TimeNs now) const noexcept;
  bool is_airborne(TimeNs now) const noexcept;
  bool is_grounded(TimeNs now) const noexcept;
  /// Datagrams that were no state text.
  std::uint32_t unreadable() const noexcept { return unreadable_; }
  /// One of them, when that is all that comes: the newest a minute.
  const DroneText& unreadable_text() const noexcept { return unreadable_text_; }

 private:
  void on_unreadable(TimeNs now, std::string_view bytes) noexcept;
  void update_battery(float reported) noexcept;
  bool is_of_now(TimeNs now, const TelloState& reported, bool connected) noexcept;

  float airborne_m_, grounded_m_;
  TelloState newest_;
  FixedVector<float, SessionSettings::battery_texts> batteries_;  ///< as reported, oldest first
  TimeNs at_ns_ = 0;
  int motor_s_ = 0;              ///< `time` of the newest text ...
  double motor_lead_s_ = -1e18;  ///< ... and by how much one was ahead of the clock at most
  int refused_texts_ = 0;        ///< in a row that are not of now
  double refused_lead_s_ = 0;    ///< of the first of them
  std::uint32_t unreadable_ = 0;
  int unreadable_in_a_row_ = 0;
  DroneText unreadable_text_;
};

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

  /// True when it is to be sent now, to a drone that stands and owes no answer. `pad`: of the newest state text.
  bool due(TimeNs now, int pad) noexcept;
  /// Its late refusal would be taken for another command's.
  bool may_be_answered(TimeNs now, TimeNs timeout_ns) const noexcept {
    return requested_ns_ != 0 && now - requested_ns_ < timeout_ns;
  }

 private:
  /// A firmware that knows no pads goes on saying that it does not look for them.
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

  FlightPhase phase() const noexcept { return phase_; }
  /// Nobody knows: it is not connected, and what was seen last was not that it stands on the ground. From link's start.
  bool may_be_airborne() const noexcept { return phase_ == FlightPhase::disconnected && !stands_; }
  /// It is in the air, or nobody knows that it is not.
  bool may_fly() const noexcept { return in_flight(phase_) || may_be_airborne(); }
  /// All handshakes with such a one failed, or it is already commanded to land.
  bool is_blind(TimeNs now) const noexcept {
    return may_be_airborne() && (lost_link_.handshakes_failed(now) || lost_link_.lands());
  }
  /// Such a one was commanded to land long enough for link to end: to the end, or briefly where nobody was ever heard.
  bool commanded_to_land(TimeNs now) const noexcept;
  /// Anything that can be read came from it.
  bool has_responded() const noexcept { return heard_; }
  /// It is not in flight, and the newest text shows it on the ground.
  bool is_standing(TimeNs now) const noexcept { return !in_flight(phase_) && reported_.is_grounded(now); }
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
  void enter(TimeNs now, FlightPhase phase) noexcept;
  void begin(TimeNs now, PendingCommand::Kind kind) noexcept { pending_.begin(now, kind, state().height_m); }
  void end_command(TimeNs now, FlightPhase phase) noexcept;
  void watch_connection(TimeNs now) noexcept;
  void watch_takeoff(TimeNs now) noexcept;
  void watch_sight(TimeNs now) noexcept;
  void watch_landing(TimeNs now) noexcept;
  void connect(TimeNs now) noexcept;
  bool should_request_pads(TimeNs now) noexcept;

  SessionSettings settings_;
  ReportedState reported_;
  LostLinkProtocol lost_link_;
  PendingCommand pending_;
  SerialCheck serial_;
  PadRequest pads_;
  FlightPhase phase_ = FlightPhase::disconnected;
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
