#pragma once
#include <functional>
#include <memory>
#include <optional>

#include "onboard/ipc/ipc.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "onboard/link/shell/loop_clock.hpp"
#include "onboard/link/shell/transport/transport.hpp"
#include "onboard/shim/mapping.hpp"

namespace ledgerline::link {

/// What link's loop talks to, by its config: drones over UDP and agent; drones behind the shim and agent; or, in
/// lockstep, the shim for both. Drones first: one may fly on by the last word of a link that died.
struct LinkEnds {
  std::optional<drone_shim::Mapping> shim;
  std::unique_ptr<Transport> drones;
  std::unique_ptr<ipc::LinkEnd> agent;
  bool needs_roudi = true;

  /// The drones' alone. Over UDP each of them is sent `command` and zero sticks at once.
  static Result<LinkEnds> open_drones(const ShellSettings& settings);
  /// An error, too, when `is_asked_to_end` says so while RouDi does not answer.
  Status connect_agent(const ShellSettings& settings, const std::function<bool()>& is_asked_to_end);
  /// To be made by the loop's thread: its first turn is a period later.
  std::unique_ptr<LoopClock> clock(const ShellSettings& settings) const;
};

}  // namespace ledgerline::link
