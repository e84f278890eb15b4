#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"

/// What endorser, orderer and committer have in common: their answers, time, settings and check of members.
namespace ledgerline::node {

/// gRPC's status codes with their numbers; the core needs no gRPC.
enum class Code {
  ok = 0,
  unknown = 2,
  invalid_argument = 3,
  not_found = 5,
  permission_denied = 7,
  failed_precondition = 9,
  aborted = 10,
  unavailable = 14,
};

/// What a service answers: bytes of the message named at the function, or a code with a message and a detail (what
/// gateway.ErrorDetail.message says; empty: none).
struct Reply {
  Code code = Code::ok;
  std::string message;
  std::string detail;
  std::string bytes;
};

/// Names that others chose are shown up to here (printable).
inline constexpr std::size_t max_name = 200;
/// So many are remembered though nothing of theirs waits for a block.
inline constexpr std::size_t max_idle_identities = 1'024;

struct Now {
  TimeNs monotonic_ns = 0;
  TimeNs real_ns = 0;  ///< for the lifetimes of certificates alone
};

struct CoreConfig {
  std::string channel = "teleop";
  std::string contract = "ledgerline";
  std::size_t batch_count = 1;                    ///< a block is cut when this many envelopes wait,
  std::size_t batch_bytes = 2'000'000;            ///< or this many bytes,
  TimeNs batch_timeout_ns = 10 * ns_per_ms;       ///< or the oldest has waited this long
  std::size_t max_envelope_bytes = 10 << 20;      ///< larger ones are refused (Fabric's AbsoluteMaxBytes)
  std::size_t max_waiting = 10'000;               ///< envelopes that wait for a block; more are refused
  std::size_t max_waiting_bytes = 64'000'000;     ///< of them together; one alone is always taken
  std::size_t identity_bytes_per_s = 8'000'000;   ///< that one identity may send for ordering on average,
  std::size_t identity_burst_bytes = 24'000'000;  ///< and at once; one alone is always taken
  /// Urgent envelopes of one identity that were not found valid, and of its organisation. A ground commands at 20 Hz:
  /// where the disk takes 5 s for a block it has 100 that wait. Twice as many would only let an invalid flood last
  /// longer.
  std::size_t urgent_of_identity = 128, urgent_of_organisation = 512;
  /// Transactions of one identity that turned out invalid, and of its organisation: beyond it nothing is ordered for it
  /// until some are forgiven (InvalidBudget). Everybody who reads blocks checks each of them, at 0.2 ms of a core.
  std::size_t invalid_of_identity = 500, invalid_of_organisation = 1'000;
  std::size_t max_stored_bytes = 256'000'000;  ///< of the values that one organisation has written
  std::vector<crypto::MspRoot> organisations;  ///< of the channel: a majority of them endorses; in the config block
  crypto::MspRoot orderers;                    ///< likewise: whose orderer signs blocks; no name: of nobody
};

/// Whether a signature is one of a member of the channel. Copies share the registry. One thread at a time.
class MemberCheck {
 public:
  MemberCheck(std::shared_ptr<crypto::MspRegistry> registry, std::string channel)
      : registry_(std::move(registry)), channel_(std::move(channel)) {}

  /// `signature` of `message` by `serialized` (a msp.SerializedIdentity); the error is in Fabric's words.
  Result<std::shared_ptr<const crypto::MspRegistry::Member>> check(std::string_view serialized,
                                                                   std::string_view message, std::string_view signature,
                                                                   Now now) const;
  /// The same of what this process itself has signed.
  Result<std::shared_ptr<const crypto::MspRegistry::Member>> check_own(std::string_view serialized, Now now) const;

 private:
  std::shared_ptr<crypto::MspRegistry> registry_;
  std::string channel_;
};

}  // namespace ledgerline::node
