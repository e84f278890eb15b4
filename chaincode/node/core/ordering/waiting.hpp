#pragma once
#include <array>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "chaincode/node/core/types.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::node {

/// Envelopes of one kind that wait for a block. They leave fairly by bytes, twice: whose organisation has sent much
/// waits behind those whose has sent little, and within an organisation the same holds for identities (start-time fair
/// queueing: Goyal, Vin, Cheng, 1996). So an organisation that mints identities gets no more by it. Those of one
/// identity keep their order. One thread at a time.
class FairLane {
 public:
  struct Entry {
    std::string envelope;
    crypto::IdentityName sender;
    TimeNs arrived_ns = 0;
    std::uint64_t turn = 0;  ///< grows with each that arrives
  };

  void add(Entry entry);
  bool empty() const { return count_ == 0; }
  /// The next one. Only where one waits.
  const Entry& front() const { return next()->second.waiting.begin()->second; }
  Entry pop();
  /// Nothing of this identity's waits any more, nor will soon.
  void forget(const crypto::IdentityName& sender);

 private:
  struct QueueKey {
    double tag = 0;          ///< the sender's bytes so far, on its organisation's clock
    std::uint64_t turn = 0;  ///< Entry::turn: of equal tags the older one first
    auto operator<=>(const QueueKey&) const = default;
  };
  struct Organisation {
    double tag = 0;    ///< its own bytes so far, on the lane's clock
    double clock = 0;  ///< the tag of its identity's that left last
    std::map<QueueKey, Entry> waiting;
    std::map<crypto::IdentityName, double> tags;  ///< of each identity, behind its newest one
  };
  using Organisations = std::map<std::string, Organisation>;  ///< as many as the channel has; kept
  Organisations::const_iterator next() const;

  Organisations organisations_;
  double clock_ = 0;  ///< the tag of the organisation's that left last
  std::size_t count_ = 0;
};

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
  std::vector<std::string> pop(std::size_t max_count, std::size_t max_bytes);

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
