// Another simulator behind link's shim, as small as one can be (docs/faults.md): drones that do what they are commanded
// at once, as points. Takes the shim's file and a number of drones; ends with SIGINT. Then, in link.toml:
//
//     [tello]
//     transport = "shim"
//     [shim]
//     memory = "/dev/shm/mine"
//
// What must be right for link to fly a drone: `command`, `takeoff`, `land` and `stop` are answered with ok, and a
// state text comes about ten times a second.
#include <atomic>
#include <charconv>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>
#include <string_view>
#include <vector>

#include "onboard/shim/mapping.hpp"

namespace {

using ledgerline::drone_shim::Datagram;
using ledgerline::drone_shim::DronesEnd;

std::atomic<bool> ended{false};

struct Drone {
  double height_cm = 0, climb_cmps = 0;  // rc's third number: 100 is 1 m/s

  /// What it answers; empty: nothing, as to rc.
  std::string_view sent(std::string_view text) {
    if (text.starts_with("rc ")) {
      const std::string_view last_two = text.substr(text.find(' ', text.find(' ', 3) + 1) + 1);
      (void)std::from_chars(last_two.data(), last_two.data() + last_two.size(), climb_cmps);
      return {};
    }
    if (text.starts_with("takeoff")) height_cm = 80;
    if (text.starts_with("land") || text.starts_with("emergency")) height_cm = climb_cmps = 0;
    return "ok";
  }
  void fly(double seconds) {
    if (height_cm > 0) height_cm += climb_cmps * seconds;
  }
  std::string state() const {
    char text[256];
    std::snprintf(text, sizeof text,
                  "pitch:0;roll:0;yaw:0;vgx:0;vgy:0;vgz:0;templ:60;temph:62;tof:%d;h:%d;bat:90;baro:100.00;time:0;"
                  "agx:0.00;agy:0.00;agz:-1000.00;\r\n",
                  static_cast<int>(height_cm) + 10, static_cast<int>(height_cm));
    return text;
  }
};

}  // namespace

int main(int argc, char** argv) {
  const int count = argc > 2 ? std::atoi(argv[2]) : 1;
  if (argc < 2 || count < 1 || count > ledgerline::max_drones) {
    std::fprintf(stderr, "usage: %s FILE [DRONES]\n", argv[0]);
    return 2;
  }
  std::signal(SIGINT, [](int) { ended = true; });
  std::signal(SIGTERM, [](int) { ended = true; });
  auto end = DronesEnd::open(argv[1]);
  if (!end) {
    std::fprintf(stderr, "%s\n", end.error().message.c_str());
    return 1;
  }
  std::puts("ready");
  std::fflush(stdout);
  std::vector<Drone> drones(static_cast<std::size_t>(count));
  const auto known = [&](ledgerline::DroneNumber number) { return number >= 1 && number <= drones.size(); };
  for (int millisecond = 0; !ended; ++millisecond) {
    for (Datagram datagram; end->receive(datagram);) {
      if (!known(datagram.drone)) continue;
      const std::string_view answer = drones[datagram.drone - 1u].sent(datagram.view());
      if (!answer.empty()) (void)end->send(datagram.drone, Datagram::Port::answer, answer);
    }
    for (std::size_t i = 0; i < drones.size(); ++i) {
      drones[i].fly(0.001);
      if (millisecond % 100 == 0)
        (void)end->send(static_cast<ledgerline::DroneNumber>(i + 1), Datagram::Port::state, drones[i].state());
    }
    const timespec turn{0, 1'000'000};
    ::nanosleep(&turn, nullptr);
  }
  return 0;
}
