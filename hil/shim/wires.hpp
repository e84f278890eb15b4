#pragma once
#include <memory>
#include <string>
#include <vector>

#include "common/program/command_socket.hpp"
#include "hil/shim/drone_ways.hpp"
#include "onboard/shim/drones_end.hpp"
#include "sim/shell/drone_wire.hpp"

/// The wires of the simulated drones of `ledgerline hil shim`. One thread.
namespace ledgerline::hil::shim {

/// The process that speaks through the shim's memory is the drones' one client.
inline constexpr sim::Endpoint link_endpoint{1, sim::command_port};

/// To the process at the other end of the memory; false: there is no room.
bool give(drone_shim::DronesEnd& end, const sim::Outgoing& datagram);

/// The shim's memory. Nobody wakes this end, since link's loop makes no system call for it: what link said is taken at
/// the simulation's next step, at most 1 ms later.
class ShimWire final : public sim::DroneWire {
 public:
  explicit ShimWire(drone_shim::DronesEnd& end) : end_(end) {}
  bool wait(TimeNs until, const sigset_t& signals_while_waiting) override;
  /// At most 256 after each wait.
  bool receive(Received& out) override;
  void send(const sim::Outgoing& datagram) override;
  std::uint64_t unsent() const override { return unsent_; }

 private:
  drone_shim::DronesEnd& end_;
  drone_shim::Datagram received_;
  std::size_t taken_ = 0;  ///< since the last wait
  std::uint64_t unsent_ = 0;
};

/// What impairs the drones' wire, and when.
struct Faults {
  std::string socket;                          ///< takes commands while it runs; empty: none
  std::vector<proxy::ScriptedFault> scripted;  ///< after its beginning
};

/// Another wire, with DroneWays behind it that a script and a socket switch.
class BentWire final : public sim::DroneWire {
 public:
  /// Checks the script as a whole; takes the socket.
  static Result<std::unique_ptr<BentWire>> open(std::unique_ptr<sim::DroneWire> wire, int drones, std::uint64_t seed,
                                                const Faults& faults);
  bool wait(TimeNs until, const sigset_t& signals_while_waiting) override;
  bool receive(Received& out) override;
  void send(const sim::Outgoing& datagram) override;
  std::uint64_t unsent() const override { return wire_->unsent(); }
  const SdkFaults::Counts& sdk_counts() const { return ways_.sdk_counts(); }

 private:
  BentWire(std::unique_ptr<sim::DroneWire> wire, int drones, std::uint64_t seed, proxy::Switches switches,
           proxy::Script script);
  Result<std::string> act(const std::string& command);
  void send_due(TimeNs now);

  std::unique_ptr<sim::DroneWire> wire_;
  DroneWays ways_;
  proxy::Switches switches_;
  proxy::Script script_;
  std::optional<CommandSocket> socket_;
  TimeNs start_ns_ = 0;  ///< 0: it has not begun
  DroneWays::ToDrone handed_;
};

}  // namespace ledgerline::hil::shim
