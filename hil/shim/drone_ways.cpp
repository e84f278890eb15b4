#include "hil/shim/drone_ways.hpp"

#include <fmt/format.h>

#include "common/base/log.hpp"

namespace ledgerline::hil::shim {
namespace {

std::uint64_t tag_of(sim::Endpoint endpoint) { return std::uint64_t{endpoint.address} << 16 | endpoint.port; }
sim::Endpoint endpoint_of(std::uint64_t tag) {
  return {static_cast<std::uint32_t>(tag >> 16), static_cast<std::uint16_t>(tag)};
}

}  // namespace

DroneWays::DroneWays(int drones, std::uint64_t seed) : sdk_(seed, static_cast<std::size_t>(drones)) {
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

std::vector<proxy::Target> DroneWays::targets(int drones) {
  std::vector<proxy::Target> targets;
  for (int k = 1; k <= drones; ++k) targets.push_back({proxy::Target::Kind::drone, fmt::format("tello{}", k), true});
  return targets;
}

void DroneWays::set(const proxy::Switches& switches) {
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    Drone& drone = drones_[i];
    for (const auto& [way, switched] :
         {std::pair(Way::to, proxy::Way::to), std::pair(Way::answers, proxy::Way::answers),
          std::pair(Way::state, proxy::Way::state)}) {
      if (const Status set = drone.link_of(way).set(switches.of(i, switched)); !set)
        spdlog::error("{}", set.error().message);
    }
    renew(drone.sensors, switches.sensors(i));
    if (const Status set = sdk_.set(i, switches.sdk(i)); !set) spdlog::error("{}", set.error().message);
  }
}

void DroneWays::from_client(TimeNs now, DroneNumber drone, sim::Endpoint client, std::string_view bytes) {
  if (drone == 0 || drone > drones_.size()) return;
  drones_[drone - 1u].link_of(Way::to).push(now, bytes, tag_of(client));
}

void DroneWays::from_drone(TimeNs now, const sim::Outgoing& datagram) {
  const std::size_t i = datagram.drone - 1u;
  Drone& drone = drones_[i];
  if (datagram.to.port != sim::state_port) {
    drone.client = datagram.to;
    sdk_.answer(now, i, datagram.bytes);
  } else {
    drone.listener = datagram.to;
    std::string text = datagram.bytes;
    if (misreport(now, drone.sensors, drone.noise, text)) sdk_.state(now, i, text);
  }
  push_due(now);
}

void DroneWays::push_due(TimeNs now) {
  while (auto unit = sdk_.pop(now)) {
    Drone& drone = drones_[unit->drone];
    drone.link_of(unit->is_state ? Way::state : Way::answers)
        .push(now, unit->bytes, tag_of(unit->is_state ? drone.listener : drone.client));
  }
}

std::optional<DroneWays::ToDrone> DroneWays::to_drone(TimeNs now) {
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    auto unit = drones_[i].link_of(Way::to).pop(now);
    if (!unit) continue;
    sdk_.command(now, i, unit->bytes);
    return ToDrone{static_cast<DroneNumber>(i + 1), endpoint_of(unit->tag), std::move(unit->bytes)};
  }
  return std::nullopt;
}

std::optional<sim::Outgoing> DroneWays::to_client(TimeNs now) {
  push_due(now);
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    for (const Way way : {Way::answers, Way::state}) {
      if (auto unit = drones_[i].link_of(way).pop(now))
        return sim::Outgoing{static_cast<DroneNumber>(i + 1), endpoint_of(unit->tag), std::move(unit->bytes)};
    }
  }
  return std::nullopt;
}

std::optional<TimeNs> DroneWays::next_due() const {
  std::optional<TimeNs> due = sdk_.next_due();
  for (const Drone& drone : drones_) {
    for (const EmulatedLink& link : drone.links) {
      const auto next = link.next_due();
      if (next && (!due || *next < *due)) due = next;
    }
  }
  return due;
}

}  // namespace ledgerline::hil::shim
