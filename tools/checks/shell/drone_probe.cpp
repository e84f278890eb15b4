#include "tools/checks/shell/host_probe.hpp"
#include "tools/checks/shell/probes.hpp"

#include <atomic>
#include <charconv>
#include <chrono>
#include <cstdlib>
#include <list>
#include <thread>

#include "common/base/text.hpp"
#include "common/dds/dds.hpp"
#include "common/dds/raw.hpp"
#include "common/msg/names.hpp"
#include "common/msg/ros.hpp"
#include "onboard/link/core/tello/tello_text.hpp"
#include "tools/checks/core/drone.hpp"
#include "tools/tello/shell/talk.hpp"

namespace ledgerline::checks {
namespace {

std::optional<double> battery_in(const std::string& answer) {
  int percent = 0;
  const auto [end, error] = std::from_chars(answer.data(), answer.data() + answer.size(), percent);
  if (error != std::errc() || percent < 0 || percent > 100) return std::nullopt;
  return percent / 100.0;
}

/// As link has it: behind the drone's interface. None: it cannot be had, which look_at_state_port says.
std::optional<link::Descriptor> listen_to_states(const std::string& listen, const std::string& interface) {
  const std::size_t colon = listen.rfind(':');
  const auto address = parse_ipv4(listen.substr(0, colon));
  const int port = colon == std::string::npos ? 0 : std::atoi(listen.c_str() + colon + 1);
  if (!address || port <= 0 || port > 65'535) return std::nullopt;
  auto socket = link::open_udp(interface);
  if (!socket || !link::listen_alone(*socket, tello::socket_address(*address, static_cast<std::uint16_t>(port))))
    return std::nullopt;
  return std::move(*socket);
}

/// What came of that drone, or comes now: a rate of zero where no state text did, and what came in place of one.
void listen_to(const link::Descriptor& socket, std::uint32_t drone, DroneInputs& inputs) {
  // A Tello sends its state ten times a second: with half of them lost, one of a thousand is not heard within one.
  constexpr TimeNs timeout_ns = 1'500 * ns_per_ms;
  bool heard = false;
  for (const TimeNs end = monotonic_ns() + timeout_ns; !heard && monotonic_ns() < end;) {
    tello::wait({socket.get()});
    tello::read_all(socket.get(), [&](std::uint32_t from, std::string_view text) {
      link::TelloState state;
      if (from != drone) return;
      if (link::parse_state(text, state))
        heard = true;
      else
        inputs.unreadable = printable(link::Quote(link::without_line_end(text)).view());
    });
  }
  if (!heard) inputs.state_hz = 0;
}

}  // namespace

Findings query_drones(const ProgramConfig& link) {
  constexpr const char* check = "drone";
  if (is_link_running()) return {flag(Problem::drones_in_use, check, link.path)};
  Findings out;
  for (const DroneKeys& drone : link.drones) {
    const auto address = parse_ipv4(drone.address);
    if (!address) continue;  // link's own reader has said so
    const auto states = listen_to_states(link.state_listen, drone.interface);
    std::vector<tello::Found> asked{{*address, tello::Dialogue({"battery?"})}};
    if (auto status = tello::query(asked, drone.interface); !status) {
      out.push_back(of_drone(drone.name, flag(Problem::drone_silent, check, status.error().message)));
      continue;
    }
    DroneInputs inputs{.name = drone.name, .address = drone.address, .interface = drone.interface};
    inputs.there = asked[0].dialogue.present();
    inputs.battery = battery_in(asked[0].dialogue.answer("battery?"));
    out.push_back(of_drone(drone.name, assess_presence(inputs)));
    if (!inputs.there) continue;
    if (states) listen_to(*states, *address, inputs);
    if (auto silent = assess_state(inputs, link.state_listen)) out.push_back(of_drone(drone.name, std::move(*silent)));
    out.push_back(of_drone(drone.name, assess_battery(inputs, link.battery_low)));
  }
  return out;
}

Findings receive_poses(const ProgramConfig& link, const ProgramConfig& agent) {
  constexpr std::chrono::milliseconds listen_for{2'500};  // writers on other hosts are found within two
  struct PoseListener {
    TopicInputs inputs;
    std::atomic<unsigned> poses{0};
    std::optional<dds::RawReader> reader{};
  };
  std::list<PoseListener> all;
  const auto type = from_name<PoseMessage>(agent.pose_type);
  for (const DroneKeys& drone : link.drones) {
    if (!drone.by_mocap || !type) continue;  // the program's own reader has said so of a wrong type
    PoseListener& one = all.emplace_back();
    one.inputs = {.drone = drone.name,
                  .topic = pose_topic_of(agent.pose_topic, drone.name),
                  .type = agent.pose_type,
                  .listened_s = std::chrono::duration<double>(listen_for).count()};
  }
  if (all.empty()) return {};
  dds::ParticipantPtr participant;
  std::string why;
  if (auto config = Config::load(agent.path); !config) {
    why = config.error().message;
  } else if (auto made = dds::Participant::create(dds::participant_options(*config, "")); !made) {
    why = made.error().message;
  } else {
    participant = std::move(*made);
  }
  for (PoseListener& one : all) {
    one.inputs.why = why;
    if (!participant) continue;
    auto reader = dds::RawReader::create(participant, one.inputs.topic, one.inputs.type, {.reliable = false},
                                         [&one, type](std::span<const std::uint8_t> cdr, const dds::RawInfo&) {
                                           const auto pose =
                                               pose_from_message(*type, dds::text_of(cdr), one.inputs.drone);
                                           if (pose && *pose) ++one.poses;
                                         });
    if (reader)
      one.reader = std::move(*reader);
    else
      one.inputs.why = reader.error().message;
  }
  if (participant) std::this_thread::sleep_for(listen_for);
  Findings out;
  for (PoseListener& one : all) {
    if (one.reader) one.inputs.writers = one.reader->writers();
    one.reader.reset();
    one.inputs.poses = one.poses;
    out.push_back(assess(one.inputs));
  }
  return out;
}

}  // namespace ledgerline::checks
