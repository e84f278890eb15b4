#pragma once
#include <cstddef>
#include <vector>

#include "common/rt/clock.hpp"
#include "ground/service/core/drone_queries.hpp"

namespace ledgerline::ground::service {

/// Operators whose session is over. Each drone that one holds is asked to land, repeatedly, and once it is down it is
/// given back; after a minute it is given back in the air, too, since a key must not stay unlocked for one who is gone.
/// Deterministic, no I/O; one thread.
class EndedSessions {
 public:
  static constexpr TimeNs limit_ns = 60 * ns_per_s, again_ns = ns_per_s;

  /// He is gone; until `from_ns` he may come back for what he holds.
  void add(std::size_t who, TimeNs from_ns);
  /// He has come back, or has nothing left.
  void remove(std::size_t who);
  bool has(std::size_t who) const;
  bool empty() const { return all_.empty(); }
  std::vector<std::size_t> all() const;

  struct Step {
    std::vector<std::size_t> land{};
    bool give_back = false;  ///< all that he holds; then remove() him
    bool last = false;       ///< whatever comes of that
  };
  /// Of one that is here, who holds that.
  Step step(TimeNs now_ns, std::size_t who, const HeldDrones& held);

 private:
  struct Gone {
    std::size_t who;
    TimeNs from_ns, until_ns;
    TimeNs next_ns;  ///< then they are asked again to land
  };
  std::vector<Gone> all_;
};

}  // namespace ledgerline::ground::service
