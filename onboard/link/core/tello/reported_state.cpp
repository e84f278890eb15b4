#include "onboard/link/core/tello/reported_state.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace ledgerline::link {
namespace {

// State text comes at 10 Hz; what is older than this does not decide about take-off or landing.
constexpr TimeNs fresh_for_ns = 500 * ns_per_ms;
// `time` is in whole seconds, and a text may come late: so far ahead of what is known it may be.
constexpr double motor_time_step_s = 1.2, motor_time_slack_s = 2;
// So many refused texts in a row whose `time` goes on as time does are right: what was accepted before them was not.
constexpr int refused_texts_needed = 10;
// Texts that cannot be read are quoted when so many came in a row, which is a second of them, and once a minute then.
constexpr int unreadable_texts_needed = 10;
constexpr TimeNs quote_pause_ns = 60 * ns_per_s;

}  // namespace

bool ReportedState::is_fresh(TimeNs now) const noexcept { return at_ns_ != 0 && now - at_ns_ < fresh_for_ns; }

bool ReportedState::is_airborne(TimeNs now) const noexcept { return is_fresh(now) && newest_.height_m >= airborne_m_; }

bool ReportedState::is_grounded(TimeNs now) const noexcept {
  return is_fresh(now) && newest_.height_m < airborne_m_ && newest_.tof_m <= grounded_m_;
}

bool ReportedState::accept_motor_time(TimeNs now, const TelloState& reported, bool connected) noexcept {
  if (!reported.has_motor_time) return true;
  const double lead_s = reported.motor_s - to_seconds(now);
  const bool follows = reported.motor_s >= motor_s_ && lead_s <= motor_lead_s_ + motor_time_slack_s;
  if (follows || !connected) {
    motor_lead_s_ = follows ? std::max(motor_lead_s_, lead_s) : lead_s;
  } else {
    refused_texts_ =
        refused_texts_ > 0 && std::abs(lead_s - refused_lead_s_) < motor_time_step_s ? refused_texts_ + 1 : 1;
    if (refused_texts_ == 1) refused_lead_s_ = lead_s;
    if (refused_texts_ < refused_texts_needed) return false;
    motor_lead_s_ = lead_s;
  }
  motor_s_ = reported.motor_s;
  refused_texts_ = 0;
  return true;
}

void ReportedState::grow_older(TimeNs slept_ns) noexcept {
  motor_lead_s_ += to_seconds(slept_ns);
  refused_texts_ = 0;
}

void ReportedState::on_unreadable(TimeNs now, std::string_view bytes) noexcept {
  ++unreadable_;
  unreadable_in_a_row_ = std::min(unreadable_in_a_row_ + 1, unreadable_texts_needed);
  if (unreadable_in_a_row_ < unreadable_texts_needed) return;
  if (unreadable_text_.at_ns == 0 || now - unreadable_text_.at_ns >= quote_pause_ns)
    unreadable_text_ = {now, Quote(without_line_end(bytes))};
}

bool ReportedState::on_text(TimeNs now, std::string_view bytes, bool connected) noexcept {
  TelloState reported = newest_;
  if (!parse_state(bytes, reported)) {
    on_unreadable(now, bytes);
    return false;
  }
  unreadable_in_a_row_ = 0;
  if (!accept_motor_time(now, reported, connected)) return false;
  newest_ = reported;
  update_battery(reported.battery);
  at_ns_ = now;
  return true;
}

void ReportedState::update_battery(float reported) noexcept {
  if (batteries_.size() == SessionSettings::battery_texts) batteries_.erase_front(1);
  batteries_.push(reported);
  const auto needed = static_cast<std::ptrdiff_t>(std::min(SessionSettings::battery_says_so, batteries_.size()));
  newest_.battery = 1;
  for (const float low : batteries_) {
    const auto says_so = [low](float battery) { return battery <= low; };
    if (std::count_if(batteries_.begin(), batteries_.end(), says_so) >= needed)
      newest_.battery = std::min(newest_.battery, low);
  }
}

}  // namespace ledgerline::link
