#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/result.hpp"
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

  /// Lockstep: link makes a turn at `now_ns` when `asked` differs from `done`; both are futexes.
  struct Turns {
    alignas(64) std::atomic<std::uint32_t> asked{0};
    std::atomic<TimeNs> now_ns{0};
    alignas(64) std::atomic<std::uint32_t> done{0};
  } turns;

  /// Lockstep alone: agent's side in place of the shared memory of onboard/ipc. When a queue is full, the newest is
  /// lost here, the oldest there.
  SpscRing<Plan, 128> plans;
  SpscRing<Pose, 256> poses;
  SpscRing<AgentHeartbeat, 8> heartbeats;
  SpscRing<StateSample, 512> states;
  SpscRing<Transition, 256> transitions;
};

enum class End : std::uint8_t { drones, link };

/// One end's hold on a shim's memory: a file in memory (tmpfs, such as /dev/shm) of this user alone, mode 0600. The
/// drones' end makes the file, or joins the link that holds its end of an older one; whichever end is the last removes
/// it. What the other side said before an end was opened, that end does not hear, as with a socket. Each end is held by
/// one process at a time, through a lock that the kernel lets go of however the process ends. Any thread; the rings in
/// the memory have threads of their own.
class Mapping {
 public:
  /// `lockstep`: whether the drones' end moves link's clock. Errors name the file and the cure: it is no file in
  /// memory, or another user's, another process holds that end, a build with another layout made it, the other end
  /// means another `lockstep`, or (link's end) nobody has made it yet.
  static Result<Mapping> open(const std::string& path, End end, bool lockstep = false);
  Mapping(Mapping&& other) noexcept;
  Mapping& operator=(Mapping&&) = delete;
  ~Mapping();

  Memory& memory() const noexcept { return *memory_; }
  /// Whether a process holds the other end now. A system call.
  bool other_lives() const noexcept;

 private:
  /// Nothing: the file was removed meanwhile, or is just being made.
  static Result<std::optional<Mapping>> try_open(const std::string& path, End end, bool lockstep);
  void forget_what_came() noexcept;
  Mapping(std::string path, End end, int fd) : path_(std::move(path)), end_(end), fd_(fd) {}

  std::string path_;
  End end_;
  int fd_ = -1;
  Memory* memory_ = nullptr;
};

/// Waits between processes until `word` is no longer `old`, at most `max_ns`; wakes early at random, so ask again.
void wait_while(const std::atomic<std::uint32_t>& word, std::uint32_t old, TimeNs max_ns) noexcept;
void wake(std::atomic<std::uint32_t>& word) noexcept;

/// The side of the drones: for `ledgerline hil shim`, and for any other simulator that is to be flown by link without
/// a network (hil/shim/example.cpp). What link says to a drone's port 8889 comes out of receive(); what the drone
/// answers, or sends as state text, goes into send(). The bytes are those of the Tello SDK. One thread.
class DronesEnd {
 public:
  /// `path`: link's [shim] memory. The error is Mapping's.
  static Result<DronesEnd> open(const std::string& path, bool lockstep = false);

  /// The next one from link; false: there is none now. `out.drone` is whatever link wrote: check it.
  bool receive(Datagram& out) noexcept { return mapping_.memory().to_drones.pop(out); }
  /// False, and lost: link did not take the 256 before it, or the text is longer than Datagram::max_bytes.
  bool send(DroneNumber drone, Datagram::Port port, std::string_view text) noexcept;
  /// Whether a link is there. A system call.
  bool is_link_alive() const noexcept { return mapping_.other_lives(); }

  enum class Turn : std::uint8_t { made, in_progress, no_link };
  /// Lockstep: asks for link's turn at the simulated time `now`, which never goes back. Then wait_turn().
  void request_turn(TimeNs now) noexcept;
  Turn wait_turn(TimeNs max_ns) noexcept;
  /// Lockstep: agent's side.
  Memory& memory() noexcept { return mapping_.memory(); }

 private:
  explicit DronesEnd(Mapping mapping) : mapping_(std::move(mapping)) {}
  Mapping mapping_;
};

}  // namespace ledgerline::drone_shim
