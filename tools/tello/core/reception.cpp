#include "tools/tello/core/reception.hpp"

#include <algorithm>

#include "common/base/text.hpp"
#include "onboard/agent/core/mocap.hpp"

namespace ledgerline::tello {

ReceivedPose ReceivedPose::of(TimeNs arrived_ns, const PoseStamped& pose) {
  ReceivedPose heard{.arrived_ns = arrived_ns,
                     .stamp_ns = pose.header.stamp_ns,
                     .position_m = pose.position_m,
                     .orientation = pose.orientation};
  pose.header.frame_id.copy(heard.frame.data(), heard.frame.size() - 1);
  return heard;
}

void Reception::Count::add(TimeNs now) {
  if (times++ == 0) first_ns = now;
  last_ns = now;
}

// What has fallen silent since is slower, too: its gap counts once it is the maximum.
double Reception::Count::rate_hz(TimeNs now) const {
  if (times < 2) return 0;
  const double gaps = static_cast<double>(times - 1), heard_s = std::max(1e-9, to_seconds(last_ns - first_ns));
  const double mean_s = heard_s / gaps, silent_s = to_seconds(now - last_ns);
  return silent_s > 3 * mean_s ? gaps / (heard_s + silent_s) : gaps / heard_s;
}

void Reception::on_state(TimeNs now, std::string_view bytes) {
  if (link::parse_state(bytes, state_))
    states_.add(now);
  else
    unreadable_ = link::Quote(link::without_line_end(bytes));
}

void Reception::on_pose(const ReceivedPose& pose) {
  const TimeNs delay_ns = pose.arrived_ns - pose.stamp_ns;
  least_delay_ns_ = poses_.times == 0 ? delay_ns : std::min(least_delay_ns_, delay_ns);
  poses_.add(pose.arrived_ns);
  pose_ = pose;
}

void Reception::report(TimeNs now, TimeNs now_real_ns, bool stamps_count, checks::DroneInputs& drone) const {
  drone.state_hz = states_.rate_hz(now);
  drone.unreadable = printable(unreadable_.view());
  if (states_.times > 0) {
    drone.battery = static_cast<double>(state_.battery);
    drone.has_velocity = state_.has_velocity;
    if (state_.temperature_c != 0) drone.temperature_c = static_cast<double>(state_.temperature_c);
  }
  if (poses_.times == 0) return;
  const TimeNs since_ns = now_real_ns - (stamps_count ? pose_.stamp_ns : poses_.last_ns);
  drone.pose = checks::PoseInputs{.age_ms = to_ms(since_ns),
                                  .rate_hz = poses_.rate_hz(now_real_ns),
                                  .delay_ms = to_ms(least_delay_ns_),
                                  .frame = printable(pose_.frame.data()),
                                  .position_m = pose_.position_m};
  if (const Status good = agent::MocapIntake::check_numbers(pose_.position_m, pose_.orientation); !good)
    drone.pose->fault = good.error().message;
}

}  // namespace ledgerline::tello
