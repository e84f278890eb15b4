#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "chaincode/node/core/ordering/fair_lane.hpp"
#include "chaincode/node/core/types.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::node {

/// Whom an envelope may overtake: each its own lane.
enum class Urgency : std::uint8_t {
  stop,     ///< overtakes all others
  control,  ///< commands, and who may do what
  none,
};

/// Who sent an envelope, and what it is.
struct Sender {
  crypto::IdentityName name;  ///< one for all certificates of an identity, and for every layout of one
  Urgency urgency = Urgency::none;
};

/// Envelopes that wait for a block, with a share for each organisation and each identity. Of five that leave four may
/// be urgent, stops first; one is not, so that no flood of one kind keeps the other out. A quarter of all places is for
/// urgent ones alone. In each lane, senders of much wait behind senders of little (FairLane). One thread at a time.
/// `config` must outlive it.
class Waiting {
 public:
  explicit Waiting(const CoreConfig& config) : config_(config) {}

  /// nullopt: it waits. Otherwise why not: too many wait, or this identity or organisation has sent more than its
  /// share.
  std::optional<std::string> add(const Sender& sender, std::string envelope, TimeNs now_ns);
  /// The next ones, at most so many and so many bytes together (the first one whatever its size); among themselves in
  /// the order in which they came.
  std::vector<std::string> take(std::size_t max_count, std::size_t max_bytes);

  bool empty() const { return count() == 0; }
  std::size_t count() const { return arrivals_.size(); }
  std::size_t bytes() const { return bytes_; }
  /// Identities that have an entry here.
  std::size_t remembered() const { return members_.size(); }
  /// Arrival time of the oldest waiting envelope. Only while one waits.
  TimeNs oldest_ns() const { return *arrivals_.begin(); }

 private:
  struct Share {
    std::array<std::size_t, 2> count{}, bytes{};  ///< waiting: urgent, others
  };
  struct Member {
    Share waiting;
    double spent_bytes = 0;  ///< of its allowance: flows back with time
    TimeNs spent_at_ns = 0;
  };

  std::optional<std::string> refusal(const Sender& sender, const Share& own, std::size_t size) const;
  std::size_t next_lane() const;
  void forget_idle(TimeNs now_ns);
  double spent(const Member& member, TimeNs now_ns) const;

  const CoreConfig& config_;
  std::array<FairLane, 3> lanes_;  ///< by Urgency
  std::map<crypto::IdentityName, Member> members_;
  std::map<std::string, Share> organisations_;  ///< as many as the channel has
  std::multiset<TimeNs> arrivals_;              ///< of all that wait
  std::uint64_t turns_ = 0;
  std::size_t urgent_in_a_row_ = 0;
  std::size_t bytes_ = 0;
};

}  // namespace ledgerline::node
