#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "common/rt/clock.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::tello {

/// Brings a Tello down, no matter who flew it: `command` until it is answered, a zero (it goes on with the last rc that
/// it got), and `land`, again each second until it is down. Down is what it says by `ok` to `land`, unless its state
/// text shows it aloft, or what its state text shows for a second. Answers carry no id: `command` and `land` both are
/// answered `ok`, so one more of them than `command`s were sent is the landing's. Core: no I/O, no clock; one thread.
class Landing {
 public:
  /// What is to be sent now, in this order.
  std::vector<std::string> due(TimeNs now);
  void on_answer(std::string_view bytes);
  void on_state(TimeNs now, std::string_view bytes);

  bool down() const { return down_; }
  /// Anything came from it.
  bool heard() const { return oks_ > 0 || seen_; }
  /// For people: what it said last that is no `ok`.
  const std::string& refusal() const { return refusal_; }

 private:
  bool aloft(TimeNs now) const;

  bool started_ = false, down_ = false, seen_ = false;
  int commands_ = 0, oks_ = 0;
  TimeNs said_ns_ = 0, state_ns_ = 0, grounded_since_ns_ = 0;
  link::TelloState state_;
  std::string refusal_;
};

}  // namespace ledgerline::tello
