#pragma once
#include <cstdint>
#include <string_view>

#include "common/msg/onboard.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// A Tello's serial number as `sn?` reports it: a-z, A-Z and 0-9, such as 0TQDG00EDPMV39.
using SerialText = FixedText<24>;

/// True for what can be a serial: 4 to 24 a-z, A-Z and 0-9. So no `ok`, no figure of a battery, no refusal.
bool is_serial(std::string_view text) noexcept;

/// Whether the drone that answers is the one that the config means. Behind an access point addresses are lent: after a
/// change of batteries one drone's address may be another's, which would be flown by the first one's poses.
///
///   open ── the serial ──▶ same: it may take off
///    │  └── another ─────▶ other: it may not, until it reconnects
///    └── refused thrice ─▶ unreported: its firmware knows no `sn?`, so nothing can be checked, and it may
///
/// Answers carry no id and any may be late, so one refusal is not taken for the answer to `sn?`, and a drone that
/// answers nothing is asked without end. Core: no I/O, no allocation; one thread.
class SerialCheck {
 public:
  enum class Verdict : std::uint8_t { unwanted, open, same, other, unreported };

  /// `wanted` empty: nothing is ever asked.
  explicit SerialCheck(std::string_view wanted) noexcept;

  /// It has reconnected: the drone that answers now must be asked.
  void begin() noexcept;
  /// True: `sn?` is to be sent now, and counts as sent. To be called only on the ground, while no other answer is
  /// waited for.
  bool request_if_due(TimeNs now) noexcept;
  /// What came while no other answer was waited for; true when it was for this.
  bool on_answer(std::string_view bytes) noexcept;

  bool allows_takeoff() const noexcept { return verdict_ != Verdict::open && verdict_ != Verdict::other; }
  Verdict verdict() const noexcept { return verdict_; }
  /// What it answered last, for `same` and `other`.
  const SerialText& answered() const noexcept { return answered_; }

 private:
  SerialText wanted_, answered_;
  Verdict verdict_;
  TimeNs asked_ns_ = 0;  ///< 0: not yet
  int refusals_ = 0;
};

}  // namespace ledgerline::link
