#pragma once
#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/loop_ticker.hpp"
#include "onboard/ipc/ipc.hpp"
#include "onboard/link/core/link_io.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "onboard/shim/mapping.hpp"

namespace ledgerline::link {

/// When the loop's turns are: by this computer's clock, or one that the shim moves (lockstep). The loop's thread.
class LoopClock {
 public:
  virtual ~LoopClock() = default;

  /// Ends the turn before, waits for the next; its time. `stopping`: link is to end, so a clock that stands is lost.
  virtual TimeNs wait(const std::atomic<bool>& stopping) noexcept = 0;
  virtual TimeNs due_ns() const noexcept = 0;
  virtual TimeNs now() const noexcept = 0;
  /// How long the host was suspended since it booted: now() stood still meanwhile.
  virtual TimeNs suspended_ns() const noexcept = 0;
  /// Nobody moves it any more: there will be no turn.
  virtual bool is_lost() const noexcept = 0;

  /// Turns that began more than a period late, and how late each one began.
  virtual std::uint64_t overruns() const noexcept = 0;
  virtual const Histogram& late() const noexcept = 0;
};

/// CLOCK_MONOTONIC, a turn every period; its system calls are the clock and the sleep.
class RealClock final : public LoopClock {
 public:
  explicit RealClock(TimeNs period_ns) noexcept : turns_(period_ns) {}
  TimeNs wait(const std::atomic<bool>&) noexcept override { return turns_.wait(); }
  TimeNs due_ns() const noexcept override { return turns_.due_ns(); }
  TimeNs now() const noexcept override { return monotonic_ns(); }
  /// CLOCK_BOOTTIME goes on while the host is suspended. The one is read behind the other, so it jitters by that.
  TimeNs suspended_ns() const noexcept override {
    const TimeNs monotonic = monotonic_ns();
    return read_clock(CLOCK_BOOTTIME) - monotonic;
  }
  bool is_lost() const noexcept override { return false; }
  std::uint64_t overruns() const noexcept override { return turns_.overruns(); }
  const Histogram& late() const noexcept override { return turns_.late(); }

 private:
  LoopTicker turns_;
};

/// How link reaches its drones: over UDP, or through the shim's shared memory with the same bytes. After it was opened,
/// receive() and send() allocate nothing, take no lock and do not wait.
///
/// Threads: receive() and send() are the loop's; refresh() is another's.
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
  virtual std::vector<std::string> refresh() = 0;
};

/// What link's loop talks to, by its config: drones over UDP and agent; drones behind the shim and agent; or, in
/// lockstep, the shim for both. Drones first: one may fly on by the last word of a link that died.
struct LinkEnds {
  std::optional<drone_shim::Mapping> shim;
  std::unique_ptr<Transport> drones;
  std::unique_ptr<ipc::LinkEnd> agent;

  /// The drones' alone. Over UDP each of them is sent `command` and zero sticks at once.
  static Result<LinkEnds> open_drones(const ShellSettings& settings);
  /// `waits`: for RouDi, which may be about to start. An error, too, when `is_asked_to_end` says so meanwhile.
  Status connect_agent(const ShellSettings& settings, const std::function<bool()>& is_asked_to_end, bool waits);
  /// To be made by the loop's thread: its first turn is a period later.
  std::unique_ptr<LoopClock> clock(const ShellSettings& settings) const;
};

}  // namespace ledgerline::link
