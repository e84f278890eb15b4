#include "hil/shim/wires.hpp"

#include <poll.h>

#include <algorithm>
#include <cerrno>

#include "common/base/log.hpp"

namespace ledgerline::hil::shim {

bool give(drone_shim::DronesEnd& end, const sim::Outgoing& datagram) {
  using Port = drone_shim::Datagram::Port;
  return end.send(datagram.drone, datagram.to.port == sim::state_port ? Port::state : Port::answer, datagram.bytes);
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
  if (!give(end_, datagram)) ++unsent_;
}

Result<std::unique_ptr<BentWire>> BentWire::open(std::unique_ptr<sim::DroneWire> wire, int drones, std::uint64_t seed,
                                                 const Faults& faults) {
  const proxy::Switches switches(DroneWays::targets(drones));
  auto script = proxy::Script::make(faults.scripted, switches);
  if (!script) return script.error();
  std::unique_ptr<BentWire> bent(new BentWire(std::move(wire), drones, seed, switches, std::move(*script)));
  if (faults.socket.empty()) return bent;
  auto socket = CommandSocket::open(faults.socket);
  if (!socket) return socket.error();
  bent->socket_.emplace(std::move(*socket));
  return bent;
}

BentWire::BentWire(std::unique_ptr<sim::DroneWire> wire, int drones, std::uint64_t seed, proxy::Switches switches,
                   proxy::Script script)
    : wire_(std::move(wire)), ways_(drones, seed), switches_(std::move(switches)), script_(std::move(script)) {}

bool BentWire::wait(TimeNs until, const sigset_t& signals_while_waiting) {
  const TimeNs now = monotonic_ns();
  if (start_ns_ == 0) start_ns_ = now;
  TimeNs wake = std::min(until, ways_.next_due().value_or(until));
  if (const auto next = script_.next()) wake = std::min(wake, start_ns_ + *next);
  const bool waited = wire_->wait(wake, signals_while_waiting);
  const TimeNs then = monotonic_ns();
  while (const auto command = script_.take(then - start_ns_)) {
    if (const auto acted = act(*command); !acted) spdlog::error("{}", acted.error().message);
  }
  if (socket_) {
    std::vector<pollfd> polled;
    socket_->add_to(then, polled);
    if (::poll(polled.data(), polled.size(), 0) > 0)
      socket_->serve(then, polled, [&](const std::string& command) { return act(command); });
  }
  for (Received received; wire_->receive(received);)
    ways_.from_client(then, received.drone, received.from, received.bytes);
  send_due(then);
  return waited;
}

bool BentWire::receive(Received& out) {
  auto due = ways_.to_drone(monotonic_ns());
  if (!due) return false;
  handed_ = std::move(*due);
  out = {handed_.drone, handed_.from, handed_.bytes};
  return true;
}

void BentWire::send(const sim::Outgoing& datagram) {
  const TimeNs now = monotonic_ns();
  ways_.from_drone(now, datagram);
  send_due(now);
}

void BentWire::send_due(TimeNs now) {
  while (const auto datagram = ways_.to_client(now)) wire_->send(*datagram);
}

Result<std::string> BentWire::act(const std::string& command) {
  if (const auto applied = switches_.apply(command); !applied) return applied.error();
  if (command == "list") return switches_.list();
  ways_.set(switches_);
  spdlog::info("{}", command);
  return std::string();
}

}  // namespace ledgerline::hil::shim
