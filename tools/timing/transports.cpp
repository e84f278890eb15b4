#include "tools/timing/transports.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "common/rt/loop_ticker.hpp"
#include "common/rt/real_time.hpp"
#include "onboard/link/shell/shim/shim_end.hpp"
#include "onboard/link/shell/transport/tello_sockets.hpp"
#include "onboard/shim/drones_end.hpp"

namespace ledgerline::timing {
namespace {

constexpr TimeNs turn_ns = ns_per_ms, setpoint_ns = 50 * ns_per_ms, state_ns = 100 * ns_per_ms;
constexpr std::size_t remembered = 1 << 16;  // newest times by number, so that a late one is told from another

/// When number i was said; the other thread reads it once it has number i.
using Times = std::array<std::atomic<TimeNs>, remembered>;

Error failed(const std::string& what) { return Error{fmt::format("{}: {}", what, std::strerror(errno))}; }

/// The drones' side: says and hears texts, each of a drone.
class Drones {
 public:
  virtual ~Drones() = default;
  /// Until something comes, or until then.
  virtual void wait(TimeNs until) = 0;
  virtual bool take(std::string& text) = 0;
  virtual void give(DroneNumber drone, std::string_view text) = 0;
};

void sleep_until(TimeNs until) {
  const timespec at{until / ns_per_s, until % ns_per_s};
  (void)::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr);
}

class ShimDrones final : public Drones {
 public:
  explicit ShimDrones(drone_shim::DronesEnd& end) : end_(end) {}
  void wait(TimeNs until) override { sleep_until(until); }
  bool take(std::string& text) override {
    if (!end_.take(datagram_)) return false;
    text = datagram_.view();
    return true;
  }
  void give(DroneNumber drone, std::string_view text) override {
    (void)end_.give(drone, drone_shim::Datagram::Port::state, text);  // what is lost is counted at link's side
  }

 private:
  drone_shim::DronesEnd& end_;
  drone_shim::Datagram datagram_;
};

class UdpDrones final : public Drones {
 public:
  static Result<std::unique_ptr<UdpDrones>> open(link::ShellSettings& settings, int drones) {
    std::unique_ptr<UdpDrones> made(new UdpDrones);
    for (int k = 1; k <= drones; ++k) {
      link::Descriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
      sockaddr_in own = loopback(static_cast<std::uint32_t>(k));
      socklen_t size = sizeof own;
      if (socket.get() < 0 || ::bind(socket.get(), reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0 ||
          ::getsockname(socket.get(), reinterpret_cast<sockaddr*>(&own), &size) != 0)
        return failed("no UDP socket for a drone");
      settings.addresses.push_back(own);
      settings.interfaces.emplace_back();
      made->polled_.push_back({socket.get(), POLLIN, 0});
      made->sockets_.push_back(std::move(socket));
    }
    // A free port for state texts: whoever takes it in between makes link's own listening fail aloud.
    link::Descriptor probe(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    made->listener_ = loopback(0);
    socklen_t size = sizeof made->listener_;
    if (::bind(probe.get(), reinterpret_cast<const sockaddr*>(&made->listener_), size) != 0 ||
        ::getsockname(probe.get(), reinterpret_cast<sockaddr*>(&made->listener_), &size) != 0)
      return failed("no free UDP port");
    settings.state_listen = made->listener_;
    settings.state_port = 0;
    return made;
  }
  void wait(TimeNs until) override {
    const TimeNs left = std::max<TimeNs>(0, until - monotonic_ns());
    const timespec timeout{left / ns_per_s, left % ns_per_s};
    (void)::ppoll(polled_.data(), polled_.size(), &timeout, nullptr);
    next_ = 0;
  }
  bool take(std::string& text) override {
    for (; next_ < polled_.size(); ++next_) {
      if (polled_[next_].revents == 0) continue;
      std::array<char, 256> buffer;
      const ssize_t got = ::recv(polled_[next_].fd, buffer.data(), buffer.size(), MSG_DONTWAIT);
      if (got < 0) continue;
      text.assign(buffer.data(), static_cast<std::size_t>(got));
      return true;
    }
    return false;
  }
  void give(DroneNumber drone, std::string_view text) override {
    (void)!::sendto(polled_[drone - 1u].fd, text.data(), text.size(), MSG_DONTWAIT,
                    reinterpret_cast<const sockaddr*>(&listener_), sizeof listener_);
  }

 private:
  static sockaddr_in loopback(std::uint32_t host) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl((127U << 24) + (77U << 16) + (1U << 8) + host + 1);
    return address;
  }
  std::vector<link::Descriptor> sockets_;
  std::vector<pollfd> polled_;
  sockaddr_in listener_{};
  std::size_t next_ = 0;
};

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

void run_drones(Drones& drones, int count, Shared& shared, TransportRun& run) {
  const double cpu_before = cpu_s();
  const TimeNs begin = monotonic_ns();
  TimeNs next = begin + turn_ns, next_state = begin;
  std::string text;
  while (!shared.ended) {
    drones.wait(next);
    TimeNs now = monotonic_ns();
    while (drones.take(text)) {
      now = monotonic_ns();
      run.to_drone.add(now - shared.setpoints[number_behind(text, "rc ")].load(std::memory_order_acquire));
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
      drones.give(static_cast<DroneNumber>(k), said);
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
      message.command = link::command_text({text.data(), written.size});
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

Result<TransportRun> run_one(const TransportsOptions& options, bool shim) {
  link::ShellSettings settings;
  for (int k = 1; k <= options.drones; ++k) {
    link::DroneSettings drone;
    drone.number = static_cast<DroneNumber>(k);
    drone.name = fmt::format("tello{}", k);
    settings.link.drones.push_back(drone);
  }
  std::optional<drone_shim::DronesEnd> memory;
  std::optional<drone_shim::Mapping> mapping;
  std::unique_ptr<Drones> drones;
  std::unique_ptr<link::Transport> transport;
  if (shim) {
    const std::string path = fmt::format("/dev/shm/ledgerline-timing-{}", ::getpid());
    auto made = drone_shim::DronesEnd::open(path);
    if (!made) return made.error();
    memory.emplace(std::move(*made));
    auto opened = drone_shim::Mapping::open(path, drone_shim::End::link);
    if (!opened) return opened.error();
    mapping.emplace(std::move(*opened));
    drones = std::make_unique<ShimDrones>(*memory);
    transport = std::make_unique<link::ShimTransport>(mapping->memory(), settings.link.drones);
  } else {
    auto made = UdpDrones::open(settings, options.drones);
    if (!made) return made.error();
    drones = std::move(*made);
    auto sockets = link::TelloSockets::create(settings);
    if (!sockets) return sockets.error();
    transport = std::make_unique<link::TelloSockets>(std::move(*sockets));
  }
  TransportRun run;
  run.shim = shim;
  const auto shared = std::make_unique<Shared>();
  std::thread drones_thread([&] { run_drones(*drones, options.drones, *shared, run); });
  std::thread loop_thread([&] { run_loop(*transport, options, *shared, run); });
  loop_thread.join();
  shared->ended = true;
  drones_thread.join();
  // State texts of the last tenth of a second may be on their way.
  const auto on_their_way = static_cast<std::uint64_t>(options.drones) * 2;
  const std::uint64_t states_lost = shared->states_said - shared->states_heard;
  run.lost = shared->setpoints_said - shared->setpoints_heard + (states_lost > on_their_way ? states_lost : 0);
  return run;
}

struct Figure {
  const char* name;
  double (*of)(const TransportRun&);
};
constexpr std::array<Figure, 9> figures{{
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

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n == 0 ? 0 : n % 2 == 1 ? values[n / 2] : (values[n / 2 - 1] + values[n / 2]) / 2;
}

struct Compared {
  double udp = 0, shim = 0, ratio = 0, lowest = 0, highest = 0;
};

// Runs come in pairs, one of each.
Compared compare(const std::vector<TransportRun>& runs, const Figure& figure) {
  std::vector<double> udp, shim, ratios;
  for (std::size_t i = 0; i + 1 < runs.size(); i += 2) {
    const TransportRun& a = runs[i].shim ? runs[i + 1] : runs[i];
    const TransportRun& b = runs[i].shim ? runs[i] : runs[i + 1];
    udp.push_back(figure.of(a));
    shim.push_back(figure.of(b));
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
  for (const Figure& figure : figures) {
    const Compared c = compare(runs, figure);
    text += fmt::format("  {:<24}{:>10.2f}{:>10.2f}{:>10.2f}   {:.2f} to {:.2f}\n", figure.name, c.udp, c.shim, c.ratio,
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
    for (const Figure& figure : figures) one[figure.name] = figure.of(run);
    all.push_back(std::move(one));
  }
  for (const Figure& figure : figures) {
    const Compared c = compare(runs, figure);
    summary[figure.name] = {
        {"udp", c.udp}, {"shim", c.shim}, {"ratio", c.ratio}, {"lowest", c.lowest}, {"highest", c.highest}};
  }
  return {{"runs", all}, {"summary", summary}};
}

}  // namespace ledgerline::timing
