#pragma once
#include <compare>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>

#include "chaincode/node/core/types.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::node {

/// Envelopes of one kind that wait for a block. They leave fairly by bytes, twice: whose organisation has sent much
/// waits behind those whose has sent little, and within an organisation the same holds for identities (start-time fair
/// queueing: Goyal, Vin, Cheng, 1996). So an organisation that mints identities gets no more by it. Those of one
/// identity keep their order. One thread at a time.
class FairLane {
 public:
  struct Held {
    std::string envelope;
    crypto::IdentityName sender;
    TimeNs arrived_ns = 0;
    std::uint64_t turn = 0;  ///< grows with each that arrives
  };

  void add(Held held);
  bool empty() const { return count_ == 0; }
  /// The next one. Only where one waits.
  const Held& front() const { return next()->second.waiting.begin()->second; }
  Held pop();
  /// Nothing of this identity's waits any more, nor will soon.
  void forget(const crypto::IdentityName& sender);

 private:
  struct Place {
    double tag = 0;          ///< the sender's bytes so far, on its organisation's clock
    std::uint64_t turn = 0;  ///< Held::turn: of equal tags the older one first
    auto operator<=>(const Place&) const = default;
  };
  struct Organisation {
    double tag = 0;    ///< its own bytes so far, on the lane's clock
    double clock = 0;  ///< the tag of its identity's that left last
    std::map<Place, Held> waiting;
    std::map<crypto::IdentityName, double> tags;  ///< of each identity, behind its newest one
  };
  using Organisations = std::map<std::string, Organisation>;  ///< as many as the channel has; kept
  Organisations::const_iterator next() const;

  Organisations organisations_;
  double clock_ = 0;  ///< the tag of the organisation's that left last
  std::size_t count_ = 0;
};

}  // namespace ledgerline::node
