#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/rt/clock.hpp"
#include "tools/doctor/core/finding.hpp"

/// What is checked of the host itself. Facts in, lines out. Pure.
namespace ledgerline::doctor {

/// A folder that a program writes to.
struct DirectoryFacts {
  std::string path;
  bool writable = false;
  std::optional<std::uint64_t> free_bytes{};
  bool read_only = false;  ///< its file system is
};
Findings assess(const DirectoryFacts& facts);

struct ClockFacts {
  bool known = false, synchronised = false;  ///< as the kernel says
  double max_error_ms = 0;
};
Finding assess(const ClockFacts& facts);

/// Of this user: link's unit has capabilities of its own.
struct RealTimeFacts {
  bool wanted = true;  ///< [realtime] priority is not 0
  bool fifo = false, locked = false;
  std::string unit{};  ///< of link, which has the rights; empty: there is none
};
Findings assess(const RealTimeFacts& facts);

struct SharedMemoryFacts {
  enum class Roudi : std::uint8_t { none, left, alive, forbidden };
  Roudi roudi = Roudi::none;
  std::string program{};  ///< that has its socket; empty: that is not to be seen
  std::string no_room{};  ///< why RouDi would not start; empty: it has room
};
Findings assess(const SharedMemoryFacts& facts);

/// A network interface by the name that `whose` config has for it.
struct InterfaceFacts {
  std::string name, whose;
  bool there = false, up = false, has_address = false;
};
Finding assess(const InterfaceFacts& facts);

/// Where the drones' state texts arrive.
struct StatePortFacts {
  std::string listen;  ///< ADDRESS:PORT
  bool taken = false;
  std::string program{};  ///< that has it; empty: it is not to be seen
  int pid = 0;
};
Finding assess(const StatePortFacts& facts);

/// The drones' names in link.toml and in agent.toml.
Finding assess_names(std::vector<std::string> of_link, std::vector<std::string> of_agent);

/// The way to a drone.
struct RouteFacts {
  std::string drone, address, wanted;  ///< `wanted`: an interface's name; empty: any
  std::string over{};                  ///< the interface; empty: there is no way
  std::string why{};                   ///< there is none
};
Finding assess(const RouteFacts& facts);

/// What a drone answered.
struct DroneFacts {
  std::string name, address;
  bool there = false;
  std::optional<double> battery{};  ///< 0..1
  double battery_low = 0.15;
  std::string listen{};          ///< ADDRESS:PORT, where its state texts arrive
  std::optional<bool> states{};  ///< whether any has come; none: nobody could listen there
};
Findings assess(const DroneFacts& facts);

/// What came of motion capture for one drone while it was listened for.
struct PoseFacts {
  std::string drone, topic, type;  ///< as agent.toml has them; ROS's names
  int writers = 0;                 ///< of that topic and type, at the end
  unsigned poses = 0;              ///< of this drone
  double listened_s = 0;
  std::string why{};  ///< why nobody could listen; empty: somebody did
};
Finding assess(const PoseFacts& facts);

}  // namespace ledgerline::doctor
