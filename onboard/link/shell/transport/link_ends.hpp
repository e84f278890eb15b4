#pragma once
#include <memory>
#include <optional>

#include "onboard/ipc/ipc.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "onboard/link/shell/loop_clock.hpp"
#include "onboard/link/shell/transport/transport.hpp"
#include "onboard/shim/mapping.hpp"

namespace ledgerline::link {

/// What link's loop talks to, by its config: drones over UDP and agent; drones behind the shim and agent; or, in
/// lockstep, the shim for both.
struct LinkEnds {
  std::optional<drone_shim::Mapping> shim;
  std::unique_ptr<Transport> drones;
  std::unique_ptr<ipc::LinkEnd> agent;
  bool needs_roudi = true;

  static Result<LinkEnds> open(const ShellSettings& settings);
  /// To be made by the loop's thread: its first turn is a period later.
  std::unique_ptr<LoopClock> clock(const ShellSettings& settings) const;
};

}  // namespace ledgerline::link
