#include "onboard/link/core/tello/pending_command.hpp"

#include <algorithm>

namespace ledgerline::link {
namespace {

// Less descent than this between two `land` means that it does not come down.
constexpr float descent_m = 0.1F;

}  // namespace

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
  out = command_text(kind_ == Kind::takeoff ? "takeoff" : kind_ == Kind::land ? "land" : "emergency");
  return true;
}

bool PadRequest::due(TimeNs now, int pad) noexcept {
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
