#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "common/crypto/identities/renewal.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/contract.hpp"

namespace ledgerline::ground::service {

inline constexpr std::size_t max_reported_blocks = 50;  ///< the newest; what is older is nobody's news

/// What a transaction was for: a function of the contract that writes, the channel's own configuration, or anything
/// else.
inline constexpr std::array<std::string_view, 18> block_kinds{contract::set,
                                                              contract::command,
                                                              contract::anchor,
                                                              contract::delete_,
                                                              contract::enroll,
                                                              contract::revoke,
                                                              contract::grant,
                                                              contract::acquire,
                                                              contract::release,
                                                              contract::request,
                                                              contract::hand_over,
                                                              contract::deny,
                                                              contract::evict,
                                                              contract::stop,
                                                              contract::clear_stop,
                                                              contract::apply_stops,
                                                              "config",
                                                              "other"};

/// What the page gets of a block: counts alone.
struct BlockSummary {
  std::uint64_t number = 0;
  TimeNs at_ns = 0;  ///< when it came; the ground's clock
  std::uint32_t transactions = 0;
  std::uint32_t ours = 0;     ///< created by the identity that ground signs with
  std::uint32_t invalid = 0;  ///< flagged so, or refused by our own check
  std::array<std::uint32_t, block_kinds.size()> kinds{};
};

/// `self`: msp.SerializedIdentity. `contract`: any other's calls are "other". Pure; any thread.
BlockSummary summary_of(const fabric::Block& block, TimeNs now, std::string_view self, std::string_view contract);

/// {"op":"blocks","blocks":[...]} of docs/station.md: those behind block `reported`, oldest first.
std::string blocks_message(const std::deque<BlockSummary>& blocks, std::uint64_t reported);

/// Whose certificates near their end among those that write drones' states: agents, whose hosts nobody may look at.
/// Read from the blocks, so an agent of any make is seen. Deterministic; one thread.
class CertificateEnds {
 public:
  static constexpr std::size_t max_writers = 256;  ///< beyond it new ones are not looked at
  /// So many transactions in a row, which is more than are in flight at a renewal: an older certificate is in use.
  static constexpr std::size_t sets_of_old = 100;

  void add(const fabric::Block& block);
  /// What is to be reported now, each once (crypto::Renewal::pop_end_notice).
  std::vector<crypto::Renewal::Notice> pop_due(std::int64_t now_s);

 private:
  struct Writer {
    std::string serialized;  ///< msp.SerializedIdentity
    std::int64_t not_before_s = 0, not_after_s = 0;
    crypto::Renewal renewal;
    std::size_t sets_of_old = 0;  ///< since the last one with this certificate
  };
  std::map<crypto::IdentityName, Writer> writers_;
};

}  // namespace ledgerline::ground::service
