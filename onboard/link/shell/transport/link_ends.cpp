#include "onboard/link/shell/transport/link_ends.hpp"

#include "common/rt/retry.hpp"
#include "onboard/link/shell/transport/shim_end.hpp"
#include "onboard/link/shell/transport/tello_sockets.hpp"

namespace ledgerline::link {
namespace {

constexpr TryLimits until_roudi{.within_ns = 1'500 * ns_per_ms};

}  // namespace

Result<LinkEnds> LinkEnds::open_drones(const ShellSettings& settings) {
  LinkEnds ends;
  if (settings.shim.empty()) {
    auto sockets = TelloSockets::create(settings);
    if (!sockets) return sockets.error();
    sockets->send_first_zero();
    ends.drones = std::make_unique<TelloSockets>(std::move(*sockets));
  } else {
    auto mapping = drone_shim::Mapping::open(settings.shim, drone_shim::End::link, settings.lockstep);
    if (!mapping) return mapping.error();
    ends.shim.emplace(std::move(*mapping));
    ends.drones = std::make_unique<ShimTransport>(ends.shim->memory(), settings.link.drones);
  }
  return ends;
}

Status LinkEnds::connect_agent(const ShellSettings& settings, const std::function<bool()>& is_asked_to_end,
                               bool waits) {
  if (settings.lockstep) {
    agent = std::make_unique<LockstepAgent>(shim->memory());
    return done;
  }
  const auto connect = [&] { return ipc::connect("ledgerline-link", is_asked_to_end); };
  const Status connected = waits ? retry("RouDi answers", until_roudi, is_asked_to_end, connect) : connect();
  if (!connected) return connected;
  auto end = ipc::LinkEnd::create();
  if (!end) return end.error();
  agent = std::move(*end);
  return done;
}

std::unique_ptr<LoopClock> LinkEnds::clock(const ShellSettings& settings) const {
  if (settings.lockstep) return std::make_unique<LockstepClock>(*shim);
  return std::make_unique<RealClock>(from_seconds(1.0 / settings.loop_hz));
}

}  // namespace ledgerline::link
