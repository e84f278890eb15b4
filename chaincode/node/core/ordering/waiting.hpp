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

/// Who sent an envelope, and what it is.
struct Sender {
  crypto::IdentityName name;  ///< one for all certificates of an identity, and for every layout of one
  bool urgent = false;        ///< a call of the contract's that commands, stops, or says who may
};

/// Envelopes that wait for a block, with a share for each identity. Urgent ones leave first, in the order in which they
/// came, and a quarter of all places is theirs alone. Of the others whoever sends much waits behind who sends little, by
/// bytes (start-time fair queueing: Goyal, Vin, Cheng, 1996); those of one identity keep their order. One thread at a
/// time. `config` must outlive it.
class Waiting {
 public:
  explicit Waiting(const CoreConfig& config) : config_(config) {}

  /// nullopt: it waits. Otherwise why not: too many wait, or this identity has sent more than its share.
  std::optional<std::string> add(const Sender& sender, std::string envelope, TimeNs now_ns);
  /// The next ones, at most so many and so many bytes together (the first one whatever its size).
  std::vector<std::string> take(std::size_t max_count, std::size_t max_bytes);

  bool empty() const { return count() == 0; }
  std::size_t count() const { return arrivals_.size(); }
  std::size_t bytes() const { return bytes_; }
  /// Identities that have an entry here.
  std::size_t remembered() const { return members_.size(); }
  /// When that one came which has waited longest. Only where one waits.
  TimeNs oldest_ns() const { return *arrivals_.begin(); }

 private:
  struct Place {
    double tag = 0;          ///< the sender's bytes so far, on the clock; of urgent ones 0
    std::uint64_t turn = 0;  ///< of equal tags the older one first
    auto operator<=>(const Place&) const = default;
  };
  struct Member {
    std::array<std::size_t, 2> count{};  ///< waiting, by lane
    std::size_t bytes = 0;               ///< of both
    double tag = 0;                      ///< behind its newest that is not urgent
    double spent_bytes = 0;              ///< of its allowance: flows back with time
    TimeNs spent_at_ns = 0;
  };
  struct Held {
    std::string envelope;
    Member* member;
    TimeNs arrived_ns;
  };
  using Lane = std::map<Place, Held>;

  std::optional<std::string> refusal(const Member& member, bool urgent, std::size_t size) const;
  void forget_idle(TimeNs now_ns);
  double spent(const Member& member, TimeNs now_ns) const;

  const CoreConfig& config_;
  std::array<Lane, 2> lanes_;                       ///< urgent, all others
  double clock_ = 0;                                ///< the tag of the one that left last and was not urgent
  std::map<crypto::IdentityName, Member> members_;  ///< one with something waiting stays where it is
  std::multiset<TimeNs> arrivals_;                  ///< of all that wait
  std::uint64_t turns_ = 0;
  std::size_t bytes_ = 0;
};

}  // namespace ledgerline::node
