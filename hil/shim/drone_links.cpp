#include "hil/shim/drone_links.hpp"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <cerrno>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/log.hpp"

namespace ledgerline::hil::shim {

bool send_to_client(drone_shim::DronesEnd& end, const sim::Outgoing& datagram) {
  using Port = drone_shim::Datagram::Port;
  return end.send(datagram.drone, datagram.to.port == state_port ? Port::state : Port::answer, datagram.bytes);
}

bool ShimWire::wait(TimeNs until, const sigset_t& signals_while_waiting) {
  taken_ = 0;
  const TimeNs left = std::max<TimeNs>(0, until - monotonic_ns());
  const timespec timeout{left / ns_per_s, left % ns_per_s};
  return ::ppoll(nullptr, 0, &timeout, &signals_while_waiting) >= 0 || errno != EINTR;
}

bool ShimWire::receive(Received& out) {
  if (taken_ == drone_shim::Memory::datagrams || !end_.receive(received_)) return false;
  ++taken_;
  out = {received_.drone, link_endpoint, received_.view()};
  return true;
}

void ShimWire::send(const sim::Outgoing& datagram) {
  if (!send_to_client(end_, datagram)) ++unsent_;
}

Result<std::unique_ptr<FaultyWire>> FaultyWire::open(std::unique_ptr<sim::DroneWire> wire, int drones,
                                                     std::uint64_t seed, const Faults& faults) {
  const proxy::Switches switches(DroneLinks::targets(drones));
  auto schedule = proxy::CommandSchedule::make(faults.scheduled, switches);
  if (!schedule) return schedule.error();
  std::unique_ptr<FaultyWire> faulty(new FaultyWire(std::move(wire), drones, seed, switches, std::move(*schedule)));
  if (faults.socket.empty()) return faulty;
  auto socket = CommandSocket::open(faults.socket);
  if (!socket) return socket.error();
  faulty->socket_.emplace(std::move(*socket));
  return faulty;
}

FaultyWire::FaultyWire(std::unique_ptr<sim::DroneWire> wire, int drones, std::uint64_t seed, proxy::Switches switches,
                       proxy::CommandSchedule schedule)
    : wire_(std::move(wire)), links_(drones, seed), switches_(std::move(switches)), schedule_(std::move(schedule)) {}

bool FaultyWire::wait(TimeNs until, const sigset_t& signals_while_waiting) {
  const TimeNs now = monotonic_ns();
  if (start_ns_ == 0) start_ns_ = now;
  TimeNs wake = std::min(until, links_.next_due().value_or(until));
  if (const auto next = schedule_.next()) wake = std::min(wake, start_ns_ + *next);
  const bool waited = wire_->wait(wake, signals_while_waiting);
  const TimeNs then = monotonic_ns();
  while (const auto command = schedule_.pop(then - start_ns_)) {
    if (const auto acted = act(*command); !acted) spdlog::error("{}", acted.error().message);
  }
  if (socket_) {
    std::vector<pollfd> polled;
    socket_->add_to(then, polled);
    if (::poll(polled.data(), polled.size(), 0) > 0)
      socket_->serve(then, polled, [&](const std::string& command) { return act(command); });
  }
  for (Received received; wire_->receive(received);)
    links_.from_client(then, received.drone, received.from, received.bytes);
  send_due(then);
  return waited;
}

bool FaultyWire::receive(Received& out) {
  auto due = links_.to_drone(monotonic_ns());
  if (!due) return false;
  handed_ = std::move(*due);
  out = {handed_.drone, handed_.from, handed_.bytes};
  return true;
}

void FaultyWire::send(const sim::Outgoing& datagram) {
  const TimeNs now = monotonic_ns();
  links_.from_drone(now, datagram);
  send_due(now);
}

void FaultyWire::send_due(TimeNs now) {
  while (const auto datagram = links_.to_client(now)) wire_->send(*datagram);
}

Result<std::string> FaultyWire::act(const std::string& command) {
  if (const auto applied = switches_.apply(command); !applied) return applied.error();
  if (command == "list") return switches_.list();
  links_.set(switches_);
  switched_.add(monotonic_ns(), command);
  spdlog::info("{}", command);
  return std::string();
}

namespace {

std::uint64_t tag_of(sim::Endpoint endpoint) { return std::uint64_t{endpoint.address} << 16 | endpoint.port; }
sim::Endpoint endpoint_of(std::uint64_t tag) {
  return {static_cast<std::uint32_t>(tag >> 16), static_cast<std::uint16_t>(tag)};
}

}  // namespace

DroneLinks::DroneLinks(int drones, std::uint64_t seed) : sdk_(seed, static_cast<std::size_t>(drones)) {
  Random seeds(seed);
  for (int k = 0; k < drones; ++k) {
    drones_.push_back({{EmulatedLink(EmulatedLink::Kind::datagrams, seeds.next()),
                        EmulatedLink(EmulatedLink::Kind::datagrams, seeds.next()),
                        EmulatedLink(EmulatedLink::Kind::datagrams, seeds.next())},
                       {},
                       Random(seeds.next()),
                       {},
                       {}});
  }
}

std::vector<proxy::Target> DroneLinks::targets(int drones) {
  std::vector<proxy::Target> targets;
  for (int k = 1; k <= drones; ++k) targets.push_back({proxy::Target::Kind::drone, fmt::format("tello{}", k), true});
  return targets;
}

void DroneLinks::set(const proxy::Switches& switches) {
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    Drone& drone = drones_[i];
    for (const Direction way : switched) {
      if (const Status set = drone.link_of(way).set(switches.of(i, way)); !set)
        spdlog::error("{}", set.error().message);
    }
    renew(drone.sensors, switches.sensors(i));
    if (const Status set = sdk_.set(i, switches.sdk(i)); !set) spdlog::error("{}", set.error().message);
  }
}

void DroneLinks::from_client(TimeNs now, DroneNumber drone, sim::Endpoint client, std::string_view bytes) {
  if (drone == 0 || drone > drones_.size()) return;
  drones_[drone - 1u].link_of(Direction::to).push(now, bytes, tag_of(client));
}

void DroneLinks::from_drone(TimeNs now, const sim::Outgoing& datagram) {
  const std::size_t i = datagram.drone - 1u;
  Drone& drone = drones_[i];
  if (datagram.to.port != state_port) {
    drone.client = datagram.to;
    sdk_.answer(now, i, datagram.bytes);
  } else {
    drone.listener = datagram.to;
    std::string text = datagram.bytes;
    if (misreport(now, drone.sensors, drone.noise, text)) sdk_.state(now, i, text);
  }
  push_due(now);
}

void DroneLinks::push_due(TimeNs now) {
  while (auto unit = sdk_.pop(now)) {
    Drone& drone = drones_[unit->drone];
    drone.link_of(unit->is_state ? Direction::state : Direction::answers)
        .push(now, unit->bytes, tag_of(unit->is_state ? drone.listener : drone.client));
  }
}

std::optional<DroneLinks::ToDrone> DroneLinks::to_drone(TimeNs now) {
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    auto unit = drones_[i].link_of(Direction::to).pop(now);
    if (!unit) continue;
    sdk_.command(now, i, unit->bytes);
    return ToDrone{static_cast<DroneNumber>(i + 1), endpoint_of(unit->tag), std::move(unit->bytes)};
  }
  return std::nullopt;
}

std::optional<sim::Outgoing> DroneLinks::to_client(TimeNs now) {
  push_due(now);
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    for (const Direction way : {Direction::answers, Direction::state}) {
      if (auto unit = drones_[i].link_of(way).pop(now))
        return sim::Outgoing{static_cast<DroneNumber>(i + 1), endpoint_of(unit->tag), std::move(unit->bytes)};
    }
  }
  return std::nullopt;
}

std::optional<TimeNs> DroneLinks::next_due() const {
  std::optional<TimeNs> due = sdk_.next_due();
  for (const Drone& drone : drones_) {
    for (const EmulatedLink& link : drone.links) due = earlier(due, link.next_due());
  }
  return due;
}

}  // namespace ledgerline::hil::shim
