#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/rt/clock.hpp"
#include "tools/checks/core/problem.hpp"

/// What is checked of the host itself. Facts in, lines out. Pure.
namespace ledgerline::checks {

/// A folder that a program writes to.
struct DirectoryInputs {
  std::string path;
  bool writable = false;
  std::optional<std::uint64_t> free_bytes{};
  bool read_only = false;  ///< its file system is
};
Findings assess(const DirectoryInputs& inputs);

struct ClockInputs {
  bool known = false, synchronised = false;  ///< as the kernel says
  double max_error_ms = 0;
};
Finding assess(const ClockInputs& inputs);

/// Of the link that runs, or else of this user: link's unit has capabilities of its own.
struct RealTimeInputs {
  bool wanted = true;  ///< [realtime] priority is not 0
  bool fifo = false, locked = false;
  int link = 0;        ///< its process; 0: none runs
  std::string unit{};  ///< of link, which has the rights; empty: there is none
};
Findings assess(const RealTimeInputs& inputs);

struct SharedMemoryInputs {
  enum class Roudi : std::uint8_t { none, left, alive, forbidden };
  Roudi roudi = Roudi::none;
  std::string program{};                   ///< that has its socket; empty: that is not to be seen
  std::vector<std::string> left_behind{};  ///< programs that a RouDi before it served
  std::string no_room{};                   ///< why RouDi would not start; empty: it has room
  std::string not_writable{};              ///< /dev/shm for this user; empty: it is
  std::string group_unusable{};            ///< why iceoryx cannot serve this user and group; empty: it can
  std::string group_shared{};              ///< who else may write to the memory; empty: nobody
  bool by_unit = false;                    ///< RouDi has a unit of systemd, so another user than doctor's
};
Findings assess(const SharedMemoryInputs& inputs);
/// The findings among those that stop RouDi from starting as this user.
Findings assess_place(const SharedMemoryInputs& inputs);

/// A network interface by the name that `whose` config has for it.
struct InterfaceInputs {
  std::string name, whose;
  bool there = false, up = false, has_address = false;
};
Finding assess(const InterfaceInputs& inputs);

/// A UDP port that is to be free: where the drones' state texts arrive, or of a simulated drone.
struct PortInputs {
  std::string listen;    ///< ADDRESS:PORT
  bool is_links = true;  ///< for state texts; false: of a simulated drone
  bool taken = false;
  std::string program{};  ///< that has it; empty: it is not to be seen
  int pid = 0;
  std::string why{};  ///< it cannot be bound, for a reason other than being taken; empty: there is none
};
Finding assess(const PortInputs& inputs);

/// A service, "agent", whose config is there and that does not run.
Finding assess_not_running(const std::string& program, const std::string& config);

/// The drones' names in link.toml and in agent.toml.
Finding assess_names(std::vector<std::string> of_link, std::vector<std::string> of_agent);

/// The way to a drone.
struct RouteInputs {
  std::string drone, address, wanted;  ///< `wanted`: an interface's name; empty: any
  std::string over{};                  ///< the interface; empty: there is no way
  std::string why{};                   ///< there is none
};
Finding assess(const RouteInputs& inputs);

/// What came of motion capture for one drone while it was listened for.
struct TopicInputs {
  std::string drone, topic, type;  ///< as agent.toml has them; ROS's names
  int writers = 0;                 ///< of that topic and type, at the end
  unsigned poses = 0;              ///< of this drone
  double listened_s = 0;
  std::string why{};  ///< why nobody could listen; empty: somebody did
};
Finding assess(const TopicInputs& inputs);

}  // namespace ledgerline::checks
