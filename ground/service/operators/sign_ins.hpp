#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::ground::service {

/// Somebody who may sign in at the station, with a key of his own.
struct Operator {
  std::string name;  ///< of his folder: "alice"
  crypto::IdentityName identity;
};

/// Who is signed in. A session is known by its token, of which a hash is kept; it ends when it is signed out, when nothing
/// came of it for `idle_ns`, or when its operator signs in anew; the newest max_ended of those are remembered. After five wrong pass phrases in a row an operator waits
/// half a minute for each one more. Deterministic, no I/O; one thread.
class SignIns {
 public:
  static constexpr int free_failures = 5;
  static constexpr TimeNs pause_ns = 30 * ns_per_s;
  static constexpr std::size_t max_ended = 64;  ///< 2 kB; a token beyond it is as good as a guessed one

  struct Session {
    std::size_t who = 0;       ///< index of the operator
    std::uint64_t number = 0;  ///< no two sessions have the same
  };

  SignIns(std::size_t operators, TimeNs idle_ns) : idle_ns_(idle_ns), slots_(operators) {}

  /// Why a pass phrase is not looked at now; empty: it is.
  std::string refused(TimeNs now, std::size_t who) const;
  /// One that is looked at counts as wrong until begin().
  void failed(TimeNs now, std::size_t who);
  /// From here on the token is this operator's.
  void begin(TimeNs now, std::size_t who, std::string_view token);
  /// The session of that token, which stays alive.
  std::optional<Session> of(TimeNs now, std::string_view token);
  /// The same of a session that is known; false: it is over.
  bool touch(TimeNs now, const Session& session);
  void end(const Session& session);
  /// Whether that token was of a session that is over.
  bool is_over(TimeNs now, std::string_view token) const;
  /// Ends what was idle for too long; whose sessions these were.
  std::vector<std::size_t> expire(TimeNs now);

 private:
  struct Slot {
    std::optional<crypto::Digest> token{};
    std::uint64_t number = 0;
    TimeNs alive_ns = 0;
    int failures = 0;
    TimeNs failed_ns = 0;
  };
  bool is_idle(TimeNs now, const Slot& slot) const { return now - slot.alive_ns > idle_ns_; }
  void forget(Slot& slot);

  const TimeNs idle_ns_;
  std::uint64_t sessions_ = 0;
  std::vector<Slot> slots_;
  std::deque<crypto::Digest> ended_;  ///< oldest first
};

}  // namespace ledgerline::ground::service
