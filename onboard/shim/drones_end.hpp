#pragma once
#include <string>
#include <string_view>

#include "onboard/shim/mapping.hpp"

namespace ledgerline::drone_shim {

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
