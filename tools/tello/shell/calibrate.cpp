#include "tools/tello/shell/calibrate.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>

#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/msg/ros.hpp"
#include "common/program/program.hpp"
#include "common/rt/spsc_ring.hpp"
#include "onboard/link/shell/transport/udp.hpp"
#include "tools/tello/core/calibrate/flight.hpp"
#include "tools/tello/shell/talk.hpp"

namespace ledgerline::tello {
namespace {

// Beyond it a stamp is of another clock: a mocap's latency is tens of ms, and only a clock that is set by NTP shows
// them.
constexpr TimeNs max_stamp_error_ns = 200 * ns_per_ms;
using PoseRing = SpscRing<PoseSample, 256>;  // a second at 250 Hz; the loop empties it each 4 ms

PoseSample sample_of(const PoseStamped& pose) {
  const auto& q = pose.orientation;
  const double yaw = std::atan2(2 * (q[3] * q[2] + q[0] * q[1]), 1 - 2 * (q[1] * q[1] + q[2] * q[2]));
  return {pose.header.stamp_ns - (realtime_ns() - monotonic_ns()), pose.position_m, yaw};
}

Result<dds::RawReader> subscribe(const CalibrationOptions& options, PoseRing& ring) {
  auto participant = dds::Participant::create(options.dds);
  if (!participant) return participant.error();
  return dds::RawReader::create(*participant, options.pose_topic, std::string(pose_type), {.reliable = false},
                                [&ring](std::span<const std::uint8_t> cdr, const dds::RawInfo&) {
                                  // One that does not fit is as one that DDS lost.
                                  if (const auto pose = pose_from_cdr(dds::text_of(cdr)))
                                    (void)ring.push(sample_of(*pose));
                                });
}

}  // namespace

bool has_consent() {
  fmt::print(stderr, "Type yes to start its motors: ");
  std::string answer;
  return std::getline(std::cin, answer) && answer == "yes";
}

Result<Record> fly_calibration(const CalibrationOptions& options) {
  catch_stop_signals();
  auto socket = link::open_udp(options.interface);
  if (!socket) return socket.error();
  auto states = link::open_udp(options.interface);
  if (!states) return states.error();
  if (!link::listen_alone(*states, socket_address(INADDR_ANY, state_port)))
    return Error{"another program listens to state text on port 8890 here: end it, for the flight needs it"};
  PoseRing ring;
  std::optional<dds::RawReader> reader;  // ends before the ring that it fills
  if (!options.pose_topic.empty()) {
    auto made = subscribe(options, ring);
    if (!made) return made.error();
    reader.emplace(std::move(*made));
  }
  CalibrationFlight flight({.repeat = options.repeat, .poses = reader.has_value()});
  std::string doing;
  while (!flight.over()) {
    const TimeNs now = monotonic_ns();
    if (stop_requested) flight.end("it was asked to end");
    for (const std::string& text : flight.pop_due(now)) (void)send_text(*socket, options.address, text);
    if (flight.doing() != doing) spdlog::info("{}", doing = flight.doing());
    wait({socket->get(), states->get()});
    read_all(socket->get(), [&](std::uint32_t from, std::string_view bytes) {
      if (from == options.address) flight.on_answer(bytes);
    });
    read_all(states->get(), [&](std::uint32_t from, std::string_view bytes) {
      if (from == options.address) flight.on_state(monotonic_ns(), bytes);
    });
    for (PoseSample pose; ring.pop(pose);) {
      if (std::abs(pose.stamp_ns - monotonic_ns()) > max_stamp_error_ns) {
        flight.end(fmt::format("a pose's stamp is {:.0f} ms from this computer's clock: its source needs the same time",
                               to_ms(std::abs(pose.stamp_ns - monotonic_ns()))));
      } else {
        flight.on_pose(pose);
      }
    }
  }
  const std::string where = ipv4_text(options.address);
  if (flight.aloft())
    spdlog::error("{} was not seen down: a Tello lands by itself 15 s after the last word that it heard", where);
  if (!flight.failure().empty()) return Error{where + ": " + flight.failure()};
  return flight.record();
}

}  // namespace ledgerline::tello
