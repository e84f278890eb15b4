#include "onboard/shim/drones_end.hpp"

namespace ledgerline::drone_shim {

Result<DronesEnd> DronesEnd::open(const std::string& path, bool lockstep) {
  auto mapping = Mapping::open(path, End::drones, lockstep);
  if (!mapping) return mapping.error();
  return DronesEnd(std::move(*mapping));
}

bool DronesEnd::give(DroneNumber drone, Datagram::Port port, std::string_view text) noexcept {
  Datagram datagram;
  datagram.drone = drone;
  datagram.port = port;
  return datagram.assign(text) && mapping_.memory().to_link.push(datagram);
}

void DronesEnd::ask_turn(TimeNs now) noexcept {
  Memory::Turns& turns = mapping_.memory().turns;
  turns.now_ns.store(now, std::memory_order_relaxed);
  turns.asked.fetch_add(1, std::memory_order_release);
  wake(turns.asked);
}

DronesEnd::Turn DronesEnd::wait_turn(TimeNs max_ns) noexcept {
  Memory::Turns& turns = mapping_.memory().turns;
  const std::uint32_t asked = turns.asked.load(std::memory_order_relaxed);
  const TimeNs until_ns = monotonic_ns() + max_ns;
  while (true) {
    const std::uint32_t done = turns.done.load(std::memory_order_acquire);
    if (done == asked) return Turn::made;
    const TimeNs left_ns = until_ns - monotonic_ns();
    if (left_ns <= 0) return link_lives() ? Turn::under_way : Turn::no_link;
    wait_while(turns.done, done, left_ns);
  }
}

}  // namespace ledgerline::drone_shim
