#include "onboard/agent/shell/mocap_input.hpp"

#include <limits>
#include <utility>

#include "common/base/log.hpp"
#include "common/msg/ros.hpp"

namespace ledgerline::agent {
namespace {

// The narrowest of three readings: this thread may be put aside between two clocks, and mocap stamps would all move.
TimeNs real_offset() {
  TimeNs narrowest = std::numeric_limits<TimeNs>::max(), offset = 0;
  for (int i = 0; i < 3; ++i) {
    const TimeNs before = monotonic_ns(), real = realtime_ns(), after = monotonic_ns();
    if (after - before >= narrowest) continue;
    narrowest = after - before;
    offset = real - (before + narrowest / 2);
  }
  return offset;
}

}  // namespace

MocapInput::MocapInput(const Settings& settings, std::string label, dds::ParticipantPtr participant,
                       std::function<void()> wake)
    : settings_(settings),
      label_(std::move(label)),
      wake_(std::move(wake)),
      intake_(real_offset, settings.mocap_stamps_are_of_this_host),
      participant_(std::move(participant)) {}

Status MocapInput::open() {
  if (settings_.mocap_topic.empty()) return done;
  for (const DroneName& drone : settings_.core.drones) {
    Input input{drone.number, std::make_unique<SpscRing<MocapMessage, 64>>(), {}};
    // Best effort hears both kinds of writers, and a pose that was lost is not worth sending again.
    auto reader = dds::RawReader::create(
        participant_, pose_topic_of(settings_.mocap_topic, drone.name), name(settings_.mocap_message),
        {.reliable = false},
        [this, ring = input.ring.get(), drone = drone.name](std::span<const std::uint8_t> cdr, const dds::RawInfo&) {
          const auto pose = pose_from_message(settings_.mocap_message, dds::text_of(cdr), drone);
          if (pose && !*pose) return;  // of others alone
          if (!pose ||
              !ring->push({(*pose)->header.stamp_ns, monotonic_ns(), (*pose)->position_m, (*pose)->orientation}))
            ++lost_;
          wake_();
        });
    if (!reader) return reader.error();
    input.reader = std::move(reader).value();
    inputs_.push_back(std::move(input));
  }
  return done;
}

void MocapInput::take(const std::function<void(DroneNumber, const MocapPose&)>& on_pose) {
  for (Input& input : inputs_) {
    MocapMessage message{};
    while (input.ring->pop(message)) {
      if (const auto pose = intake_.take(message)) {
        on_pose(input.drone, *pose);
      } else {
        report_implausible(input.drone, message);
      }
    }
  }
}

void MocapInput::report_implausible(DroneNumber drone, const MocapMessage& message) {
  if (++implausible_ > 1) return;
  const TimeNs stamp_ns = message.source_real_ns - clock().offset_ns();
  spdlog::warn(
      "{}a mocap pose of drone {} is not trusted (stamp {:.0f} ms before its arrival, quaternion's norm {:.3f}); "
      "if its computer's clock differs from this one's, set clock = \"arrival\" in [mocap]",
      label_, drone, to_ms(message.arrived_ns - stamp_ns), MocapIntake::norm(message));
}

void MocapInput::count(ShellCounters& counters) const {
  counters.mocap_implausible = implausible_;
  counters.mocap_lost = lost_;
  for (const Input& input : inputs_) counters.mocap_lost += input.reader->refused().total();
}

}  // namespace ledgerline::agent
