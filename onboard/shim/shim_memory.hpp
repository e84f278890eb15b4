#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <string_view>

#include "common/msg/onboard.hpp"
#include "common/rt/spsc_ring.hpp"

/// The shared memory that stands in place of the Tello's UDP link (docs/faults.md): plain data, laid out alike in both
/// processes because both are of one build (`layout` says so).
namespace ledgerline::drone_shim {

/// What would be one UDP datagram between a client and a drone.
struct Datagram {
  static constexpr std::size_t max_bytes = 1024;  ///< a longer one is refused; a Tello's state text has some 140

  /// The two ports that a client hears: 8889 and 8890. To a drone everything goes to its 8889.
  enum class Port : std::uint8_t { answer, state };

  DroneNumber drone = 0;
  Port port = Port::answer;
  std::uint16_t size = 0;
  std::array<char, max_bytes> bytes;

  /// Bounded, whatever the other process wrote into `size`.
  std::string_view view() const noexcept {
    return {bytes.data(), size <= max_bytes ? std::size_t{size} : std::size_t{max_bytes}};
  }
  /// False: too long, and nothing is changed.
  bool assign(std::string_view text) noexcept {
    if (text.size() > max_bytes) return false;
    size = static_cast<std::uint16_t>(text.size());
    text.copy(bytes.data(), text.size());
    return true;
  }
};

/// Everything between the two processes. Each ring has one producer and one consumer; a full one refuses the newest,
/// which the producer counts, as a socket's full buffer would.
struct Memory {
  static constexpr std::uint64_t layout = 0x4c4c'5348'494d'0001;  ///< "LLSHIM", and a number for each change
  static constexpr std::size_t datagrams = 256;

  std::atomic<std::uint64_t> ready{0};  ///< `layout`, once all below is built
  std::uint64_t bytes = 0;              ///< of this struct, as its maker knows it
  bool lockstep = false;                ///< the drones' end moves link's clock

  SpscRing<Datagram, datagrams> to_link, to_drones;

  /// Lockstep alone: link makes a turn when `asked` differs from `done`, at the simulated time `now_ns`; both are
  /// futexes.
  struct Turns {
    alignas(64) std::atomic<std::uint32_t> asked{0};
    std::atomic<TimeNs> now_ns{0};
    alignas(64) std::atomic<std::uint32_t> done{0};
  } turns;

  /// Lockstep alone: agent's side of the shared memory between link and agent, whose queues have these lengths
  /// (onboard/ipc/ipc.cpp), but here the newest goes when one is full.
  SpscRing<Plan, 128> plans;
  SpscRing<Pose, 256> poses;
  SpscRing<AgentHeartbeat, 8> heartbeats;
  SpscRing<StateSample, 512> states;
  SpscRing<Transition, 256> transitions;
};

}  // namespace ledgerline::drone_shim
