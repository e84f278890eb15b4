#pragma once
#include <span>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "onboard/link/core/link_io.hpp"

namespace ledgerline::link {

struct ShellSettings;

/// How link reaches its drones: over UDP, or through the shim's shared memory with the same bytes. After it was opened,
/// receive() and send() allocate nothing, take no lock and do not wait.
///
/// Threads: receive() and send() are the loop's; tend() is another's.
class Transport {
 public:
  virtual ~Transport() = default;

  /// Everything that has come, up to a bound; valid until the next call.
  virtual std::span<const Received> receive() noexcept = 0;
  /// False when there was no way to send it, which the caller counts: to a drone it is a lost datagram.
  virtual bool send(const ToSend& message) noexcept = 0;
  /// When the network device had the newest datagram to a drone, once each and as soon as it is known, a turn later at
  /// the earliest [CLOCK_MONOTONIC]. Of what no device stamps: nothing.
  struct AtDevice {
    DroneNumber drone = 0;
    TimeNs t_ns = 0;
  };
  virtual std::span<const AtDevice> at_device() noexcept { return {}; }
  /// To be called about once a second, beside the loop; what changed since, for people.
  virtual std::vector<std::string> tend() = 0;
};

}  // namespace ledgerline::link
