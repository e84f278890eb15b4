#pragma once
#include <array>

#include "common/rt/clock.hpp"

namespace ledgerline::link {

/// Whether another client commands this drone as well: a Tello sends its state texts to the client that sent `command`
/// last, so a link of another host with this drone's address, or a tool, silently takes them away. Two signs, of which
/// neither is a proof:
///
///     contested   twice within a minute its texts, away for seconds, came back with link's own `command`. Radio that
///                 is back brings texts by itself, and a drone that was switched off and on does so once
///     diverted    it answers, but no text comes: taken away, or held back by a firewall
///
/// Core; one thread.
class ClientWatch {
 public:
  static constexpr TimeNs away_ns = 2 * ns_per_s;        ///< twenty texts; half is a bad moment of radio
  static constexpr TimeNs at_once_ns = 300 * ns_per_ms;  ///< behind `command`: two texts and a way there and back
  static constexpr TimeNs within_ns = 60 * ns_per_s;     ///< half is two of the rounds by which links take turns

  void on_command(TimeNs now) noexcept { command_ns_ = now; }
  void on_text(TimeNs now) noexcept;
  void on_answer(TimeNs now) noexcept;

  bool contested(TimeNs now) const noexcept { return returned_ns_[1] != 0 && now - returned_ns_[1] < within_ns; }
  bool diverted(TimeNs now) const noexcept {
    return answered_ns_ > text_ns_ && text_ns_ != 0 && now - answered_ns_ > at_once_ns;
  }

 private:
  TimeNs text_ns_ = 0, command_ns_ = 0;
  TimeNs answered_ns_ = 0;               ///< the first answer since texts were away
  std::array<TimeNs, 2> returned_ns_{};  ///< when texts came back with `command`, the newest first
};

}  // namespace ledgerline::link
