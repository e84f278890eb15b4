#include "onboard/link/shell/transport/shim_end.hpp"

namespace ledgerline::link {

ShimTransport::ShimTransport(drone_shim::Memory& memory, const std::vector<DroneSettings>& drones) : memory_(memory) {
  for (const DroneSettings& drone : drones) drones_.set(drone.number);
}

std::span<const Received> ShimTransport::receive() noexcept {
  std::size_t count = 0;
  // Outsiders' count as well: they must not hold the loop.
  for (std::size_t taken = 0; taken < max_received; ++taken) {
    drone_shim::Datagram& datagram = datagrams_[count];
    if (!memory_.to_link.pop(datagram)) break;
    if (datagram.drone > max_drones || !drones_[datagram.drone]) continue;
    const Port port = datagram.port == drone_shim::Datagram::Port::state ? Port::state : Port::answer;
    received_[count++] = {datagram.drone, port, datagram.view()};
  }
  return {received_.data(), count};
}

bool ShimTransport::send(const ToSend& message) noexcept {
  drone_shim::Datagram datagram;
  datagram.drone = message.drone;
  return datagram.assign(message.command.view()) && memory_.to_drones.push(datagram);
}

void LockstepClock::end_turn() noexcept {
  if (!in_turn_) return;
  in_turn_ = false;
  turns_.done.fetch_add(1, std::memory_order_release);
  drone_shim::wake(turns_.done);
}

TimeNs LockstepClock::wait(const std::atomic<bool>& stopping) noexcept {
  constexpr TimeNs look_ns = 200 * ns_per_ms;
  end_turn();
  const std::uint32_t done = turns_.done.load(std::memory_order_relaxed);
  const auto stands = [&] { return turns_.asked.load(std::memory_order_acquire) == done; };
  while (stands()) {
    drone_shim::wait_while(turns_.asked, done, look_ns);
    if (!stands()) break;
    lost_ = stopping.load(std::memory_order_relaxed) || !mapping_.other_lives();
    if (lost_) return now_ns_;
  }
  in_turn_ = true;
  now_ns_ = turns_.now_ns.load(std::memory_order_relaxed);
  return now_ns_;
}

}  // namespace ledgerline::link
