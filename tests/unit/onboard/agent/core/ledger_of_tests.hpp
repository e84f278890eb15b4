#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/access/access.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::agent::testing {

/// Makes blocks of real Fabric transactions with test signatures: proposal, result, endorsement, creator's signature
/// and chain, each of which a test can spoil.
class LedgerOfTests {
 public:
  struct Spoil {
    bool creator_signature = false;
    bool endorsement_signature = false;
    bool proposal_hash = false;
  };
  struct Tx {
    crypto::IdentityName creator = operator_name();
    crypto::IdentityName endorser = peer_name();
    std::string event_name = "command";
    std::string event_payload;
    std::optional<fabric::Call> asked{};  ///< what the creator signed; none: what an honest peer made this event of
    std::string channel = "teleop";
    std::string contract = "ledgerline";
    int code = 0;
    bool by_flag = false;
    Spoil spoil;
  };

  static crypto::IdentityName operator_name() { return {"Org2MSP", "CN=User1@org2.ledgerline"}; }
  static crypto::IdentityName peer_name() { return {"Org1MSP", "CN=peer0.org1.ledgerline"}; }

  fabric::Transaction transaction(const Tx& tx);
  /// The next block of the chain.
  fabric::Block block(const std::vector<Tx>& transactions);
  /// Leaves out one block number and its hash, so that the next block breaks the chain.
  void lose_a_block() { (void)block({}); }

 private:
  std::uint64_t next_number_ = 7;
  std::uint64_t next_nonce_ = 1;
  std::string previous_hash_ = std::string(32, 'p');
};

Control control(const std::string& drone, std::uint64_t epoch);
/// A stop by operator_name().
Stop stop_of(const std::string& drone, bool cut = false);

}  // namespace ledgerline::agent::testing
