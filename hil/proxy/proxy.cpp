#include "hil/proxy/drone_side.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/prctl.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/program/command_socket.hpp"
#include "common/program/program.hpp"
#include "hil/proxy/server_side.hpp"

namespace ledgerline::hil::proxy {
namespace {

constexpr TimeNs max_wait = ns_per_s;

class Proxy {
 public:
  static Result<Proxy> open(const Settings& settings);

  void announce() const;
  Status run_until_signal();
  Status write_summary() const;

 private:
  Proxy(const Settings& settings, Switches switches, CommandSchedule schedule)
      : settings_(settings), switches_(std::move(switches)), schedule_(std::move(schedule)) {}
  TimeNs next_wake(TimeNs now) const;
  void turn(TimeNs now);
  Result<std::string> act(TimeNs now, const std::string& command);
  void set_all();

  Settings settings_;
  Switches switches_;
  CommandSchedule schedule_;
  std::optional<SharedPorts> shared_;
  std::vector<DroneSide> drones_;
  std::vector<ServerSide> servers_;
  std::optional<CommandSocket> socket_;
  TimeNs start_ = 0;
  std::vector<pollfd> polled_;
  std::uint64_t outsiders_ = 0;
  TimeNs latest_ = 0;  // how much later than due the loop came to it, at most
  SwitchedCommands switched_;
};

Result<Proxy> Proxy::open(const Settings& settings) {
  const Switches switches(settings.targets());
  auto schedule = CommandSchedule::make(settings.faults, switches);  // which reads its recordings for both
  if (!schedule) return schedule.error();
  Proxy proxy(settings, switches, std::move(*schedule));
  Random seeds(settings.seed);
  for (const DroneRoute& route : settings.drones) {
    auto side = DroneSide::open(route, settings.source, seeds.next());
    if (!side) return side.error();
    proxy.drones_.push_back(std::move(*side));
  }
  if (!settings.drones.empty()) {
    auto shared = SharedPorts::open(settings.source);
    if (!shared) return shared.error();
    proxy.shared_.emplace(std::move(*shared));
  }
  for (const ServerRoute& route : settings.servers) {
    auto side = ServerSide::open(route, seeds.next());
    if (!side) return side.error();
    proxy.servers_.push_back(std::move(*side));
  }
  if (!settings.faults_socket.empty()) {
    auto socket = CommandSocket::open(settings.faults_socket);
    if (!socket) return socket.error();
    proxy.socket_.emplace(std::move(*socket));
  }
  return proxy;
}

void Proxy::announce() const {
  nlohmann::json servers = nlohmann::json::object();
  for (const ServerSide& side : servers_) servers[side.route().name] = address_text(side.listening());
  std::puts(nlohmann::json{{"ready", true}, {"servers", servers}}.dump().c_str());
  std::fflush(stdout);
}

Status Proxy::run_until_signal() {
  const sigset_t waiting = catch_stop_signals_while_waiting();
  ::prctl(PR_SET_TIMERSLACK, ns_per_us);  // 50 us otherwise
  announce();
  start_ = monotonic_ns();
  while (!stop_requested) {
    const TimeNs now = monotonic_ns();
    while (const auto command = schedule_.pop(now - start_)) {
      if (const auto acted = act(now, *command); !acted) spdlog::error("{}", acted.error().message);
    }
    polled_.clear();
    if (shared_) polled_.insert(polled_.end(), {{shared_->state(), POLLIN, 0}, {shared_->video(), POLLIN, 0}});
    for (const DroneSide& side : drones_) side.add_to(polled_);
    for (const ServerSide& side : servers_) side.add_to(now, polled_);
    if (socket_) socket_->add_to(now, polled_);
    const TimeNs wake = next_wake(now);
    const TimeNs left = std::max<TimeNs>(0, wake - now);
    const timespec timeout{left / ns_per_s, left % ns_per_s};
    if (::ppoll(polled_.data(), polled_.size(), &timeout, &waiting) < 0) {
      if (errno == EINTR) continue;
      return Error{fmt::format("cannot wait for {} sockets: {}", polled_.size(), std::strerror(errno))};
    }
    const TimeNs then = monotonic_ns();
    if (wake < now + max_wait) latest_ = std::max(latest_, then - wake);
    turn(then);
  }
  return done;
}

TimeNs Proxy::next_wake(TimeNs now) const {
  TimeNs wake = now + max_wait;
  const auto consider = [&](std::optional<TimeNs> due) { wake = std::min(wake, due.value_or(wake)); };
  for (const DroneSide& side : drones_) consider(side.next_due());
  for (const ServerSide& side : servers_) consider(side.next_due(now));
  if (const auto next = schedule_.next()) consider(start_ + *next);
  return wake;
}

// The sockets lie in polled_ in the order in which run_until_signal() put them there.
void Proxy::turn(TimeNs now) {
  std::span<const pollfd> left(polled_);
  const auto take = [&](std::size_t count) { return std::exchange(left, left.subspan(count)).first(count); };
  if (shared_) {
    const auto ports = take(2);
    if (ports[0].revents != 0) outsiders_ += receive_shared(ports[0].fd, Direction::state, now, drones_);
    if (ports[1].revents != 0) outsiders_ += receive_shared(ports[1].fd, Direction::video, now, drones_);
  }
  for (DroneSide& side : drones_) {
    side.receive(now, take(side.sockets()));
    side.send(now);
  }
  for (ServerSide& side : servers_) side.serve(now, take(side.sockets()));
  if (socket_) socket_->serve(now, left, [&](const std::string& command) { return act(now, command); });
}

Result<std::string> Proxy::act(TimeNs now, const std::string& command) {
  if (const auto applied = switches_.apply(command); !applied) return applied.error();
  if (command == "list") return switches_.list();
  set_all();
  switched_.add(now, command);
  spdlog::info("{}", command);
  return std::string();
}

void Proxy::set_all() {
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    for (const Direction way : {Direction::to, Direction::answers, Direction::state, Direction::video})
      drones_[i].impair(way, switches_.of(i, way));
    drones_[i].misreport(switches_.sensors(i));
  }
  for (std::size_t i = 0; i < servers_.size(); ++i) {
    const std::size_t target = drones_.size() + i;
    for (const Direction way : {Direction::to, Direction::from}) servers_[i].impair(way, switches_.of(target, way));
    if (switches_.pop_cut(target)) servers_[i].cut();
  }
}

Status Proxy::write_summary() const {
  if (settings_.summary_file.empty()) return done;
  nlohmann::json summary{{"seed", settings_.seed},
                         {"drones", nlohmann::json::array()},
                         {"servers", nlohmann::json::array()},
                         {"outsiders", outsiders_},
                         {"latest_ms", to_ms(latest_)}};
  switched_.report_to(summary);
  for (const DroneSide& side : drones_) summary["drones"].push_back(side.summary());
  for (const ServerSide& side : servers_) summary["servers"].push_back(side.summary());
  return write_file(settings_.summary_file, summary.dump(2) + "\n");
}

}  // namespace

Status run(const Settings& settings) {
  auto proxy = Proxy::open(settings);
  if (!proxy) return proxy.error();
  if (auto ran = proxy->run_until_signal(); !ran) return ran;
  return proxy->write_summary();
}

}  // namespace ledgerline::hil::proxy
