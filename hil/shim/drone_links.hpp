#pragma once
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/program/command_socket.hpp"
#include "hil/netem/emulated_link.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"
#include "hil/proxy/switches.hpp"
#include "onboard/shim/mapping.hpp"
#include "sim/core/simulator.hpp"
#include "sim/shell/drone_sockets.hpp"

/// The wires of the simulated drones of `ledgerline hil shim`. One thread.
namespace ledgerline::hil::shim {

/// What lies between clients and simulated drones, without a network: for each drone three emulated links with
/// their delay and loss (to it, its answers, its state text), what its state text says wrongly, and what goes wrong at
/// its SDK. A core; the same seed, switches and calls give the same bytes. One thread; `now` never goes back.
class DroneLinks {
 public:
  DroneLinks(int drones, std::uint64_t seed);

  /// The drones as targets of switches: tello1, tello2, ... No video: the simulator sends none.
  static std::vector<proxy::Target> targets(int drones);
  /// From now on; of Switches over targets().
  void set(const proxy::Switches& switches);

  /// What a client said to a drone. Datagrams for an unknown drone are dropped.
  void from_client(TimeNs now, DroneNumber drone, sim::Endpoint client, std::string_view bytes);
  /// What a drone sends to its client: an answer, or state text (to port 8890).
  void from_drone(TimeNs now, const sim::Outgoing& datagram);

  struct ToDrone {
    DroneNumber drone = 0;
    sim::Endpoint from;
    std::string bytes;
  };
  /// What is due; call until there is none.
  std::optional<ToDrone> to_drone(TimeNs now);
  std::optional<sim::Outgoing> to_client(TimeNs now);
  const SdkFaults::Counts& sdk_counts() const { return sdk_.counts(); }
  /// When one of the two will give something; none: not before something comes or is switched.
  std::optional<TimeNs> next_due() const;

 private:
  using Direction = proxy::Direction;
  static constexpr std::array switched{Direction::to, Direction::answers, Direction::state};  ///< by value
  static_assert(static_cast<std::size_t>(Direction::state) + 1 == switched.size());
  struct Drone {
    std::array<EmulatedLink, switched.size()> links;
    std::vector<SensorFault> sensors;
    Random noise;
    sim::Endpoint client;    ///< that said the newest command: answers of the SDK's faults go there
    sim::Endpoint listener;  ///< where its state text goes
    EmulatedLink& link_of(Direction way) { return links[static_cast<std::size_t>(way)]; }
  };
  void push_due(TimeNs now);
  std::vector<Drone> drones_;
  SdkFaults sdk_;
};

/// The process that speaks through the shim's memory is the drones' one client.
inline constexpr sim::Endpoint link_endpoint{1, command_port};

/// To the process at the other end of the memory; false: there is no room.
bool send_to_client(drone_shim::DronesEnd& end, const sim::Outgoing& datagram);

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
  std::string socket;                            ///< takes commands while it runs; empty: none
  std::vector<proxy::ScheduledFault> scheduled;  ///< after its beginning
};

/// Another wire, with DroneLinks behind it that a schedule and a socket switch.
class FaultyWire final : public sim::DroneWire {
 public:
  /// Checks the schedule as a whole; takes the socket.
  static Result<std::unique_ptr<FaultyWire>> open(std::unique_ptr<sim::DroneWire> wire, int drones, std::uint64_t seed,
                                                  const Faults& faults);
  bool wait(TimeNs until, const sigset_t& signals_while_waiting) override;
  bool receive(Received& out) override;
  void send(const sim::Outgoing& datagram) override;
  std::uint64_t unsent() const override { return wire_->unsent(); }
  /// What was switched, as the proxy's summary has it.
  void report_to(nlohmann::json& summary) const override { switched_.report_to(summary); }
  const SdkFaults::Counts& sdk_counts() const { return links_.sdk_counts(); }

 private:
  FaultyWire(std::unique_ptr<sim::DroneWire> wire, int drones, std::uint64_t seed, proxy::Switches switches,
             proxy::CommandSchedule schedule);
  Result<std::string> act(const std::string& command);
  void send_due(TimeNs now);

  std::unique_ptr<sim::DroneWire> wire_;
  DroneLinks links_;
  proxy::Switches switches_;
  proxy::CommandSchedule schedule_;
  std::optional<CommandSocket> socket_;
  TimeNs start_ns_ = 0;  ///< 0: it has not begun
  proxy::SwitchedCommands switched_;
  DroneLinks::ToDrone handed_;
};

}  // namespace ledgerline::hil::shim
