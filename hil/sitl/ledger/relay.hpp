#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::hil {

/// What a peer says happened, in place of what was asked for. It has its real key: every result is rightly endorsed,
/// and every transaction rightly signed by its creator.
enum class RelayTampering : std::uint8_t {
  none,
  // The event of a command is another plan.
  plan_speed,     ///< 2 m/s ahead
  plan_climb,     ///< 1 m/s up
  plan_turn,      ///< turns at 3 rad/s
  plan_takeoff,   ///< a flight becomes a take-off
  plan_land,      ///< ... a landing
  plan_fly,       ///< a take-off or landing becomes a climb
  plan_times,     ///< all of it a second later
  plan_longer,    ///< its last velocity for half a second more
  plan_drone,     ///< of another drone
  plan_boot,      ///< of another start of link
  plan_stamp,     ///< of a state before
  plan_sequence,  ///< its number is a thousand higher
  plan_epoch,     ///< of the next lease
  plan_added,     ///< a take-off besides
  plan_left_out,  ///< nothing at all
  plan_form,      ///< faster, and in JSON
  plan_replayed,  ///< the event of a command before, with a new number
  // The event of a command is another function's.
  command_acquire,      ///< another takes the lease
  command_release,      ///< nobody holds it
  command_clear_stop,   ///< nothing is stopped
  command_enroll,       ///< another owns the drone
  command_apply_stops,  ///< the epoch is another
  command_cut,          ///< motors off
  command_silent,       ///< no event
  command_other,        ///< of another transaction
  // The event of a drone host's own states.
  frame_cut,         ///< motors off
  frame_acquire,     ///< another takes the lease
  frame_release,     ///< nobody holds it
  frame_clear_stop,  ///< nothing is stopped
  frame_enroll,      ///< another owns the drone
  frame_back,        ///< the lease of the epoch before
  frame_flies,       ///< the host itself takes the lease, and then flies
  frame_pose,        ///< the drone is three metres away
  frame_replayed,    ///< an older state, with a new number
  // The event of an operator's stop, and of the apply_stops that a drone's host sends behind it.
  stop_cut,            ///< motors off
  stop_other,          ///< somebody else's stop
  apply_stops_clears,  ///< nothing is stopped any more
  apply_stops_back,    ///< another's lease of the epoch before
  // What was asked for: the arguments in the envelope that comes back.
  asked_plan,      ///< another plan
  asked_function,  ///< another function
};

/// Tampers with what a peer answers to its callers. The ledger itself stays as the contract left it. One thread;
/// deterministic.
class Relay {
 public:
  /// Who signs, and whose drones and lease it tampers with.
  struct Names {
    crypto::SigningIdentity peer;
    crypto::IdentityName drone_host, holder;
  };
  explicit Relay(Names names) : names_(std::move(names)) {}

  void set_tampering(RelayTampering tampering) { tampering_ = tampering; }
  /// Whether clients compare events with what they asked for before they sign, as real ones do; otherwise they sign
  /// whatever is of their call.
  void compared(bool compared) { compared_ = compared; }
  bool compared() const { return compared_; }

  /// An endorsed common.Envelope without signature, in place of the peer's honest one.
  std::string tamper(const fabric::Call& call, std::string envelope);

 private:
  struct Event {
    std::string name, payload;
  };
  std::optional<Event> tampered_command(const std::string& payload);
  std::optional<Event> tampered_batch(const std::string& payload);
  std::optional<Event> tampered_stop(const std::string& payload) const;
  std::optional<Event> host_flies(const SetCall& batch);

  Control record_of(const std::string& drone) const;

  Names names_;
  RelayTampering tampering_ = RelayTampering::none;
  bool compared_ = false;
  std::string earlier_command_, earlier_batch_;
  std::uint64_t host_sequence_ = 0;
};

}  // namespace ledgerline::hil
