#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"
#include "common/verification/control_records.hpp"

namespace ledgerline::ground::service {

/// Somebody who may sign in at the station, with a key of his own.
struct Operator {
  std::string name;  ///< of his folder: "alice"
  crypto::IdentityName identity;
};

/// An operator's wrong pass phrases. Five attempts of each address are free, twenty of all together. After that, one
/// attempt of an address is checked every 5 s, and at most four wait. Nobody is locked out, unless somebody at his own
/// address tries without end. Deterministic; one thread.
class Attempts {
 public:
  static constexpr int free_of_address = 5, free_of_all = 20;
  static constexpr TimeNs pause_ns = 5 * ns_per_s;  ///< 17,000 guesses a day: nothing beside a phrase of four words
  static constexpr std::size_t max_waiting = 4, max_addresses = 64;

  /// When one from there is looked at, now or later; nothing: too many wait.
  std::optional<TimeNs> next_attempt(TimeNs now, const std::string& address);
  void failed(const std::string& address);

 private:
  struct Address {
    int failures = 0;
    TimeNs waits_until_ns = 0;  ///< of the newest that waits, or did
  };
  std::map<std::string, Address> addresses_;
  int failures_ = 0;  ///< of all
};

/// Indexes of those whose role was taken or is another one by now: they sign nothing any more. One whose role the
/// ledger does not know is not among them; the contract refuses what he signs.
std::vector<std::size_t> dismissed(const std::vector<Operator>& operators,
                                   const verification::RolesByOrganisation& roles);

/// Who is signed in. A session is known by its token, of which a hash is kept; it ends when it is signed out, when
/// nothing came of it for `idle_ns`, or when its operator signs in again; the newest max_ended of those are remembered.
/// Wrong pass phrases make guessing slow, and lock nobody out: Attempts. Deterministic, no I/O; one thread.
class SignIns {
 public:
  static constexpr std::size_t max_ended = 64;  ///< 2 kB; a token beyond it is as good as a guessed one

  struct Session {
    std::size_t who = 0;       ///< index of the operator
    std::uint64_t number = 0;  ///< no two sessions have the same
  };

  SignIns(std::size_t operators, TimeNs idle_ns) : idle_ns_(idle_ns), slots_(operators) {}

  /// When a pass phrase from that address is looked at; nothing: it is not, there are too many before it.
  std::optional<TimeNs> next_attempt(TimeNs now, std::size_t who, const std::string& address) {
    return slots_[who].attempts.next_attempt(now, address);
  }
  /// One that is looked at counts as wrong until right().
  void failed(std::size_t who, const std::string& address) { slots_[who].attempts.failed(address); }
  void right(std::size_t who) { slots_[who].attempts = {}; }
  /// From here on the token is this operator's, who is not dismissed.
  void begin(TimeNs now, std::size_t who, std::string_view token);
  /// The session of that token, which stays alive.
  std::optional<Session> of(TimeNs now, std::string_view token);
  /// The same of a session that is known; false: it is over.
  bool touch(TimeNs now, const Session& session);
  void end(const Session& session);
  /// Replaces the set of dismissed operators, who may sign nothing; returns those whose sessions ended by that.
  std::vector<std::size_t> dismiss(std::vector<std::size_t> who);
  bool is_dismissed(std::size_t who) const;
  /// Whether that token was of a session that is over.
  bool is_over(TimeNs now, std::string_view token) const;
  /// Ends what was idle for too long; whose sessions these were.
  std::vector<std::size_t> expire(TimeNs now);

 private:
  struct Slot {
    std::optional<crypto::Digest> token{};
    std::uint64_t number = 0;
    TimeNs alive_ns = 0;
    Attempts attempts{};
  };
  bool is_idle(TimeNs now, const Slot& slot) const { return now - slot.alive_ns > idle_ns_; }
  void forget(Slot& slot);

  const TimeNs idle_ns_;
  std::uint64_t sessions_ = 0;
  std::vector<Slot> slots_;
  std::vector<std::size_t> dismissed_;
  std::deque<crypto::Digest> ended_;  ///< oldest first
};

}  // namespace ledgerline::ground::service
