#include "tools/timing/self_test.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <pthread.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "common/rt/loop_ticker.hpp"
#include "hil/shim/drone_links.hpp"
#include "onboard/link/shell/transport/shim_end.hpp"
#include "onboard/link/shell/transport/tello_sockets.hpp"
#include "onboard/shim/mapping.hpp"
#include "sim/shell/drone_sockets.hpp"

namespace ledgerline::timing {
namespace {

constexpr TimeNs turn_ns = ns_per_ms, setpoint_ns = 50 * ns_per_ms, state_ns = 100 * ns_per_ms;
// Over UDP: where link hears state texts; the drones' addresses are behind it.
constexpr sim::Endpoint listener{(127U << 24) + (77U << 16) + (1U << 8) + 1, state_port};
constexpr std::size_t remembered = 1 << 16;  // newest times by number, so that a late one is distinguished from another

/// When number i was said; the other thread reads it once it has number i.
using Times = std::array<std::atomic<TimeNs>, remembered>;

double cpu_s() {
  rusage usage{};
  ::getrusage(RUSAGE_THREAD, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

/// The number behind the first `mark` in a text.
std::size_t number_behind(std::string_view text, std::string_view mark) {
  const std::size_t at = text.find(mark);
  std::size_t number = 0;
  if (at != std::string_view::npos)
    (void)std::from_chars(text.data() + at + mark.size(), text.data() + text.size(), number);
  return number % remembered;
}

struct Shared {
  Times setpoints{}, states{};
  std::atomic<bool> ended{false};
  std::uint64_t setpoints_said = 0, states_said = 0, setpoints_heard = 0, states_heard = 0;
};

// As long as a Tello's own.
std::string state_text(std::uint64_t number) {
  return fmt::format(
      "pitch:0;roll:0;yaw:0;vgx:0;vgy:0;vgz:0;templ:60;temph:62;tof:10;h:0;bat:90;baro:100.00;time:{};agx:0.00;agy:0."
      "00;"
      "agz:-1000.00;\r\n",
      number);
}

void run_drones(sim::DroneWire& wire, int count, Shared& shared, TransportRun& run) {
  sigset_t waiting;
  ::pthread_sigmask(SIG_SETMASK, nullptr, &waiting);
  const double cpu_before = cpu_s();
  const TimeNs begin = monotonic_ns();
  TimeNs next = begin + turn_ns, next_state = begin;
  while (!shared.ended) {
    wire.wait(next, waiting);
    TimeNs now = monotonic_ns();
    for (sim::DroneWire::Received received; wire.receive(received);) {
      now = monotonic_ns();
      run.to_drone.add(now - shared.setpoints[number_behind(received.bytes, "rc ")].load(std::memory_order_acquire));
      ++shared.setpoints_heard;
    }
    if (now < next) continue;
    next += turn_ns * ((now - next) / turn_ns + 1);
    if (now < next_state) continue;
    next_state += state_ns;
    for (int k = 1; k <= count; ++k) {
      const std::uint64_t number = shared.states_said++ % remembered;
      const std::string said = state_text(number);
      shared.states[number].store(monotonic_ns(), std::memory_order_release);
      wire.send({static_cast<DroneNumber>(k), listener, said});
    }
  }
  run.drones_percent = 100 * (cpu_s() - cpu_before) / to_seconds(monotonic_ns() - begin);
}

void run_loop(link::Transport& transport, const TransportsOptions& options, Shared& shared, TransportRun& run) {
  run.notices = enter_real_time(options.priority, options.cpu).notices;
  const double cpu_before = cpu_s();
  const TimeNs begin = monotonic_ns(), end = begin + from_seconds(options.seconds);
  TimeNs next_setpoint = begin, receive_ns = 0, send_ns = 0;
  LoopTicker turns(turn_ns);
  for (TimeNs now = begin; now < end;) {
    now = turns.wait();
    const TimeNs before = monotonic_ns();
    const auto received = transport.receive();
    const TimeNs after = monotonic_ns();
    receive_ns += after - before;
    for (const link::Received& one : received) {
      run.to_link.add(after - shared.states[number_behind(one.bytes, "time:")].load(std::memory_order_acquire));
      ++shared.states_heard;
    }
    if (now < next_setpoint || now >= end - setpoint_ns) continue;  // the last ones must still come
    next_setpoint += setpoint_ns;
    for (int k = 1; k <= options.drones; ++k) {
      const std::uint64_t number = shared.setpoints_said++ % remembered;
      link::ToSend message{static_cast<DroneNumber>(k), {}};
      std::array<char, 32> text{};
      const auto written = fmt::format_to_n(text.data(), text.size(), "rc {} 0 0 0", number);
      message.command = link::CommandText(std::string_view(text.data(), written.size));
      const TimeNs said = monotonic_ns();
      shared.setpoints[number].store(said, std::memory_order_release);
      (void)transport.send(message);  // what is lost is counted at the drones' side
      send_ns += monotonic_ns() - said;
    }
  }
  run.loop_percent = 100 * (cpu_s() - cpu_before) / to_seconds(monotonic_ns() - begin);
  run.receive_us = static_cast<double>(receive_ns) / 1e3 / static_cast<double>(turns.count());
  run.send_us =
      static_cast<double>(send_ns) / 1e3 / static_cast<double>(std::max<std::uint64_t>(1, shared.setpoints_said));
  run.late = turns.late();
}

struct Ends {
  std::optional<drone_shim::DronesEnd> memory;
  std::optional<drone_shim::Mapping> mapping;
  std::unique_ptr<sim::DroneWire> drones;
  std::unique_ptr<link::Transport> link;
};

Status open_shim(const link::ShellSettings& settings, Ends& ends) {
  const std::string path = fmt::format("/dev/shm/ledgerline-timing-{}", ::getpid());
  auto made = drone_shim::DronesEnd::open(path);
  if (!made) return made.error();
  ends.memory.emplace(std::move(*made));
  auto opened = drone_shim::Mapping::open(path, drone_shim::End::link);
  if (!opened) return opened.error();
  ends.mapping.emplace(std::move(*opened));
  ends.drones = std::make_unique<hil::shim::ShimWire>(*ends.memory);
  ends.link = std::make_unique<link::ShimTransport>(ends.mapping->memory(), settings.link.drones);
  return done;
}

Status open_udp(link::ShellSettings& settings, Ends& ends) {
  const auto drones = static_cast<int>(settings.link.drones.size());
  auto wire = sim::DroneSockets::open(listener.address + 1, drones);
  if (!wire) return wire.error();
  ends.drones = std::make_unique<sim::DroneSockets>(std::move(*wire));
  const auto at = [](std::uint32_t address, std::uint16_t port) {
    sockaddr_in place{};
    place.sin_family = AF_INET;
    place.sin_addr.s_addr = htonl(address);
    place.sin_port = htons(port);
    return place;
  };
  settings.state_listen = at(listener.address, listener.port);
  for (int k = 1; k <= drones; ++k)
    settings.addresses.push_back(at(listener.address + static_cast<std::uint32_t>(k), command_port));
  settings.interfaces.resize(settings.addresses.size());
  auto sockets = link::TelloSockets::create(settings);
  if (!sockets) return sockets.error();
  ends.link = std::make_unique<link::TelloSockets>(std::move(*sockets));
  return done;
}

Result<TransportRun> run_one(const TransportsOptions& options, bool shim) {
  link::ShellSettings settings;
  for (int k = 1; k <= options.drones; ++k) {
    link::DroneSettings drone;
    drone.number = static_cast<DroneNumber>(k);
    drone.name = fmt::format("tello{}", k);
    settings.link.drones.push_back(drone);
  }
  Ends ends;
  if (const Status opened = shim ? open_shim(settings, ends) : open_udp(settings, ends); !opened) return opened.error();
  TransportRun run;
  run.shim = shim;
  const auto shared = std::make_unique<Shared>();
  std::thread drones_thread([&] { run_drones(*ends.drones, options.drones, *shared, run); });
  std::thread loop_thread([&] { run_loop(*ends.link, options, *shared, run); });
  loop_thread.join();
  shared->ended = true;
  drones_thread.join();
  // State texts of the last tenth of a second may be on their way.
  const auto on_their_way = static_cast<std::uint64_t>(options.drones) * 2;
  const std::uint64_t states_lost = shared->states_said - shared->states_heard;
  run.lost = shared->setpoints_said - shared->setpoints_heard + (states_lost > on_their_way ? states_lost : 0);
  return run;
}

struct Metric {
  const char* name;
  double (*of)(const TransportRun&);
};
constexpr std::array<Metric, 9> metrics{{
    {"receive, us a turn", [](const TransportRun& r) { return r.receive_us; }},
    {"send, us", [](const TransportRun& r) { return r.send_us; }},
    {"to the drone, us, p50",
     [](const TransportRun& r) { return 1e-3 * static_cast<double>(r.to_drone.quantile(0.5)); }},
    {"to the drone, us, p99",
     [](const TransportRun& r) { return 1e-3 * static_cast<double>(r.to_drone.quantile(0.99)); }},
    {"to link, us, p50", [](const TransportRun& r) { return 1e-3 * static_cast<double>(r.to_link.quantile(0.5)); }},
    {"to link, us, p99", [](const TransportRun& r) { return 1e-3 * static_cast<double>(r.to_link.quantile(0.99)); }},
    {"turns late, us, p99.9", [](const TransportRun& r) { return 1e-3 * static_cast<double>(r.late.quantile(0.999)); }},
    {"loop's CPU, %", [](const TransportRun& r) { return r.loop_percent; }},
    {"drones' CPU, %", [](const TransportRun& r) { return r.drones_percent; }},
}};

struct Compared {
  double udp = 0, shim = 0, ratio = 0, lowest = 0, highest = 0;
};

// Runs come in pairs, one of each.
Compared compare(const std::vector<TransportRun>& runs, const Metric& metric) {
  std::vector<double> udp, shim, ratios;
  for (std::size_t i = 0; i + 1 < runs.size(); i += 2) {
    const TransportRun& a = runs[i].shim ? runs[i + 1] : runs[i];
    const TransportRun& b = runs[i].shim ? runs[i] : runs[i + 1];
    udp.push_back(metric.of(a));
    shim.push_back(metric.of(b));
    if (udp.back() > 0) ratios.push_back(shim.back() / udp.back());
  }
  Compared all{median(udp), median(shim), median(ratios), 0, 0};
  if (ratios.empty()) return all;
  all.lowest = *std::min_element(ratios.begin(), ratios.end());
  all.highest = *std::max_element(ratios.begin(), ratios.end());
  return all;
}

}  // namespace

Result<std::vector<TransportRun>> run_transports(const TransportsOptions& options) {
  std::vector<TransportRun> runs;
  for (int pair = 0; pair < options.pairs; ++pair) {
    for (const bool second : {false, true}) {
      auto run = run_one(options, second == (pair % 2 == 0));
      if (!run) return run.error();
      runs.push_back(std::move(*run));
    }
  }
  return runs;
}

std::string to_table(const std::vector<TransportRun>& runs) {
  std::string text =
      fmt::format("\n  {:<24}{:>10}{:>10}{:>10}   {}\n", "", "UDP", "shim", "ratio", "lowest to highest");
  for (const Metric& metric : metrics) {
    const Compared c = compare(runs, metric);
    text += fmt::format("  {:<24}{:>10.2f}{:>10.2f}{:>10.2f}   {:.2f} to {:.2f}\n", metric.name, c.udp, c.shim, c.ratio,
                        c.lowest, c.highest);
  }
  std::uint64_t lost = 0;
  for (const TransportRun& run : runs) lost += run.lost;
  text += fmt::format("\n  {} pairs; lost: {}\n", runs.size() / 2, lost);
  for (const std::string& notice : runs.empty() ? std::vector<std::string>() : runs.front().notices)
    text += "  note: " + notice + "\n";
  return text;
}

nlohmann::json to_json(const std::vector<TransportRun>& runs) {
  nlohmann::json all = nlohmann::json::array(), summary = nlohmann::json::object();
  for (const TransportRun& run : runs) {
    nlohmann::json one{{"transport", run.shim ? "shim" : "udp"}, {"lost", run.lost}};
    for (const Metric& metric : metrics) one[metric.name] = metric.of(run);
    all.push_back(std::move(one));
  }
  for (const Metric& metric : metrics) {
    const Compared c = compare(runs, metric);
    summary[metric.name] = {
        {"udp", c.udp}, {"shim", c.shim}, {"ratio", c.ratio}, {"lowest", c.lowest}, {"highest", c.highest}};
  }
  return {{"runs", all}, {"summary", summary}};
}

}  // namespace ledgerline::timing
