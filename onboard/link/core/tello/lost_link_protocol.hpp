#pragma once
#include <cstdint>

#include "common/rt/fixed_vector.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// What link sends to a drone that it gets no state of, and when. It may fly all the same: on the last rc of a link
/// that died, or only what the drone sends is lost. So link begins with a zero, never waits for an answer, and never
/// goes on for so long that it keeps a flying Tello from landing by itself (15 s without a command):
///
// clang-format off
///            all handshakes failed, stop, LAND, cut            blind_land_for
///    seeks ─────────────────────────────────────────▶ lands ◀────────────────▶ is silent
///    `command`, zero; bounded              `command`, zero, `land`    silence  nothing
///                                          or `emergency`, repeated
// clang-format on
///
/// A drone that is known to stand on the ground is sought without an end. Core: no I/O, no allocation; one thread.
class LostLinkProtocol {
 public:
  enum class Command : std::uint8_t { land, emergency };
  /// Who requests it: the lease's holder (ground repeats LAND), the contract, the local stop key.
  enum class Requester : std::uint8_t { holder, contract, local };

  explicit LostLinkProtocol(const SessionSettings& settings) noexcept : settings_(settings) {}

  /// From the beginning, as after a start.
  void seek() noexcept;
  /// The command was sent for long already: silence, then the command again.
  void begin_silence(TimeNs now, Command command) noexcept;
  /// Sends the command from now on, unless it is, or was and the silence goes on. `emergency` outranks `land`.
  void land(TimeNs now, Command command) noexcept;
  /// Restarts sending. The local key: always. The contract: once a round. The holder: once a round, and only in the
  /// silence, unless he asked earlier. Contract and holder: not before the command was first sent.
  void land_again(TimeNs now, Requester by) noexcept;

  /// What is to be sent now, one at a time and in its order; called until it returns false, at every step while the
  /// drone is not seen. `may_be_airborne`: it is not known to stand on the ground.
  bool next_send(TimeNs now, bool may_be_airborne, CommandText& out) noexcept;
  /// It is seen: what is still to be sent is not.
  void drop_commands() noexcept { commands_.clear(); }

  Command command() const noexcept { return command_; }
  /// All handshakes have failed. Then it sends nothing more, until land().
  bool handshakes_failed(TimeNs now) const noexcept;
  /// The command is or was sent: a drone that is found in the air now is to land.
  bool lands() const noexcept { return stage_ != Stage::seeks; }
  /// It was sent for at least so long, or to its end.
  bool has_sent_for(TimeNs now, TimeNs duration) const noexcept;

 private:
  enum class Stage : std::uint8_t { seeks, lands, silent };

  /// What goes out now, in this order: `command`, a zero, the landing's command.
  struct Due {
    bool handshake = false, zero = false, landing = false;
  };

  void enter(TimeNs now, Stage stage) noexcept;
  Due advance(TimeNs now, bool may_be_airborne) noexcept;
  void begin_round() noexcept { for_holder_ = for_contract_ = true; }
  Due advance_seeking(TimeNs now, bool may_be_airborne) noexcept;

  SessionSettings settings_;
  Stage stage_ = Stage::seeks;
  Command command_ = Command::land;
  TimeNs stage_since_ns_ = 0;
  int handshakes_ = 0;
  bool for_holder_ = true, for_contract_ = true;  ///< may it be sent again in this round
  FixedVector<CommandText, 3> commands_;          ///< still to be sent
  TimeNs timeout_ns_ = 0, sent_ns_ = 0, zero_ns_ = 0;
};

}  // namespace ledgerline::link
