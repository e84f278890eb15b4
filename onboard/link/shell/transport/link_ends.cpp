#include "onboard/link/shell/transport/link_ends.hpp"

#include "onboard/link/shell/shim/shim_end.hpp"
#include "onboard/link/shell/transport/tello_sockets.hpp"

namespace ledgerline::link {

Result<LinkEnds> LinkEnds::open(const ShellSettings& settings) {
  LinkEnds ends;
  if (settings.shim.empty()) {
    auto sockets = TelloSockets::create(settings);
    if (!sockets) return sockets.error();
    ends.drones = std::make_unique<TelloSockets>(std::move(*sockets));
  } else {
    auto mapping = drone_shim::Mapping::open(settings.shim, drone_shim::End::link, settings.lockstep);
    if (!mapping) return mapping.error();
    ends.shim.emplace(std::move(*mapping));
    ends.drones = std::make_unique<ShimTransport>(ends.shim->memory(), settings.link.drones);
  }
  if (settings.lockstep) {
    ends.needs_roudi = false;
    ends.agent = std::make_unique<LockstepAgent>(ends.shim->memory());
    return ends;
  }
  if (auto status = ipc::connect("ledgerline-link"); !status) return status.error();
  auto agent = ipc::LinkEnd::create();
  if (!agent) return agent.error();
  ends.agent = std::move(*agent);
  return ends;
}

std::unique_ptr<LoopClock> LinkEnds::clock(const ShellSettings& settings) const {
  if (settings.lockstep) return std::make_unique<LockstepClock>(*shim);
  return std::make_unique<RealClock>(from_seconds(1.0 / settings.loop_hz));
}

}  // namespace ledgerline::link
