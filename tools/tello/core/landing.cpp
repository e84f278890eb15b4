#include "tools/tello/core/landing.hpp"

#include "common/base/text.hpp"

namespace ledgerline::tello {
namespace {

constexpr TimeNs repeat_ns = 1 * ns_per_s;        // as link: with half a drone may answer twice
constexpr TimeNs fresh_for_ns = 500 * ns_per_ms;  // state text comes at 10 Hz
constexpr TimeNs grounded_for_ns = 1 * ns_per_s;
constexpr float airborne_m = 0.25F, grounded_m = 0.15F;  // as link's SessionSettings
constexpr std::size_t max_refusal = 60;

}  // namespace

bool Landing::aloft(TimeNs now) const {
  return seen_ && now - state_ns_ < fresh_for_ns && (state_.height_m >= airborne_m || state_.tof_m > grounded_m);
}

std::vector<std::string> Landing::due(TimeNs now) {
  // An ok counts when it comes, but not against the sight.
  if (oks_ > commands_ && started_ && !aloft(now)) down_ = true;
  if (down_ || (started_ && now - said_ns_ < repeat_ns)) return {};
  said_ns_ = now;
  started_ = true;
  std::vector<std::string> words;
  if (oks_ == 0) {
    words.emplace_back("command");
    ++commands_;
  }
  words.emplace_back("rc 0 0 0 0");
  words.emplace_back("land");
  return words;
}

void Landing::on_answer(std::string_view bytes) {
  switch (link::parse_answer(bytes)) {
    case link::Answer::ok:
      ++oks_;
      break;
    case link::Answer::refused:
      refusal_ = printable(link::without_line_end(bytes), max_refusal);
      break;
    case link::Answer::unknown:
      break;
  }
}

void Landing::on_state(TimeNs now, std::string_view bytes) {
  if (!link::parse_state(bytes, state_)) return;
  seen_ = true;
  state_ns_ = now;
  if (aloft(now)) {
    grounded_since_ns_ = 0;
  } else if (grounded_since_ns_ == 0) {
    grounded_since_ns_ = now;
  } else if (started_ && now - grounded_since_ns_ >= grounded_for_ns) {
    down_ = true;
  }
}

}  // namespace ledgerline::tello
