#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "common/base/result.hpp"
#include "onboard/shim/shim_memory.hpp"

namespace ledgerline::drone_shim {

/// The two processes that share one memory.
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

/// Waits until `word` is no longer `old`, or for at most `max_ns`; wakes early at random, so ask again. Between
/// processes.
void wait_while(const std::atomic<std::uint32_t>& word, std::uint32_t old, TimeNs max_ns) noexcept;
/// Wakes who waits for it.
void wake(std::atomic<std::uint32_t>& word) noexcept;

/// The side of the drones: for `ledgerline hil shim`, and for any other simulator that is to be flown by link without
/// a network (hil/shim/example.cpp). What link says to a drone's port 8889 comes out of take(); what the drone answers,
/// or sends as state text, goes into give(). The bytes are those of the Tello SDK. One thread.
class DronesEnd {
 public:
  /// `path`: link's [shim] memory. The error is Mapping's.
  static Result<DronesEnd> open(const std::string& path, bool lockstep = false);

  /// The next one from link; false: there is none now. `out.drone` is whatever link wrote: check it.
  bool take(Datagram& out) noexcept { return mapping_.memory().to_drones.pop(out); }
  /// False, and lost: link did not take the 256 before it, or the text is longer than Datagram::max_bytes.
  bool give(DroneNumber drone, Datagram::Port port, std::string_view text) noexcept;
  /// Whether a link is there. A system call.
  bool link_lives() const noexcept { return mapping_.other_lives(); }

  enum class Turn : std::uint8_t { made, under_way, no_link };
  /// Lockstep: asks for link's turn at the simulated time `now`, which never goes back. Then wait_turn() until it is
  /// made.
  void ask_turn(TimeNs now) noexcept;
  Turn wait_turn(TimeNs max_ns) noexcept;
  /// Lockstep: agent's side.
  Memory& memory() noexcept { return mapping_.memory(); }

 private:
  explicit DronesEnd(Mapping mapping) : mapping_(std::move(mapping)) {}
  Mapping mapping_;
};

}  // namespace ledgerline::drone_shim
