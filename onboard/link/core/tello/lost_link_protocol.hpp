#pragma once
#include <cstdint>

#include "onboard/link/core/settings.hpp"

namespace ledgerline::link {

/// What link says to a drone that it does not see, and when. It may fly all the same: on the last rc of a link that
/// died, or with only its voice lost. So the talk begins with a zero, never waits for an answer, and never goes on for
/// so long that it keeps a flying Tello from landing by itself (15 s without a command):
///
// clang-format off
///            all handshakes failed, stop, LAND, cut            blind_land_for
///    seeks ─────────────────────────────────────────▶ lands ◀────────────────▶ is silent
///    `command`, zero; bounded              `command`, zero, `land`    silence  nothing
///                                          or `emergency`, repeated
// clang-format on
///
/// A drone that is known to stand on the ground is sought without an end: nobody holds that one up. Core: no I/O, no
/// allocation; one thread.
class LostLinkProtocol {
 public:
  enum class Word : std::uint8_t { land, emergency };
  /// Who asks: the lease's holder (ground says LAND over and over), the contract, the local stop key.
  enum class Asker : std::uint8_t { holder, contract, local };

  explicit LostLinkProtocol(const SessionSettings& settings) noexcept : settings_(settings) {}

  /// From the beginning, as after a start.
  void seek() noexcept;
  /// The command was sent for long already: silence, then the command again.
  void be_silent(TimeNs now, Word word) noexcept;
  /// Sends the command from now on; no effect while it is sent, or was sent and the silence goes on. `emergency`
  /// outranks `land`.
  void land(TimeNs now, Word word) noexcept;
  /// A request while the command is sent, or was: it is sent from the beginning. For the local key always, for the
  /// contract once in each round, for the holder once and only in the silence, if he did not ask before it.
  void land_again(TimeNs now, Asker asker) noexcept;

  /// What goes out now, in this order.
  struct Due {
    bool command = false, zero = false, word = false;
  };
  /// At every step while the drone is not seen. `may_fly`: it is not known to stand on the ground.
  Due due(TimeNs now, bool may_fly) noexcept;

  Word word() const noexcept { return word_; }
  /// All handshakes have failed. Then it sends nothing more, until land().
  bool in_vain(TimeNs now) const noexcept;
  /// The word is or was said: who is found in the air now is to come down.
  bool lands() const noexcept { return stage_ != Stage::seeks; }
  /// It was said for at least so long, or to its end.
  bool said_for(TimeNs now, TimeNs duration) const noexcept;

 private:
  enum class Stage : std::uint8_t { seeks, lands, silent };

  void enter(TimeNs now, Stage stage) noexcept;
  void begin_round() noexcept { for_holder_ = for_contract_ = true; }
  Due due_seeking(TimeNs now, bool may_fly) noexcept;

  SessionSettings settings_;
  Stage stage_ = Stage::seeks;
  Word word_ = Word::land;
  TimeNs stage_since_ns_ = 0;
  int handshakes_ = 0;
  bool for_holder_ = true, for_contract_ = true;  ///< may it be said again in this round
  TimeNs timeout_ns_ = 0, said_ns_ = 0, zero_ns_ = 0;
};

}  // namespace ledgerline::link
