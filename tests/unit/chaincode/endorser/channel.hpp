#pragma once
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "chaincode/node/core/endorser.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/fabric/validation/block_validator.hpp"
#include "common/fabric/validation/key_state.hpp"
#include "tests/unit/common/fabric/validation/drafts.hpp"
#include "tests/unit/common/fabric/validation/signed_chain.hpp"

/// A channel of Fabric's in process: its orderer, and the peers' half that validates and answers, with real
/// certificates.
namespace ledgerline::endorser {

inline constexpr auto library = crypto::Library::libcrypto;

struct Member {
  crypto::SigningIdentity identity;
  std::string certificate_pem;
};
Member issue(const fabric::Organisation& organisation, const std::string& name, const std::string& unit,
             int days = 3650);

/// Everybody, made once for all seeds: keys cost more than anything else.
struct People {
  const fabric::Organisation first{"Org1MSP"}, second{"Org2MSP"}, third{"Org3MSP"}, orderers{"OrdererMSP"},
      impostors{"Org1MSP"}, forgers{"OrdererMSP"};
  const Member orderer = issue(orderers, "orderer", "orderer"), forger = issue(forgers, "orderer", "orderer");
  const std::vector<Member> peers{issue(first, "peer0", "peer"), issue(second, "peer0", "peer"),
                                  issue(third, "peer0", "peer")};
  const Member admin = issue(first, "Admin", "admin");
  /// Each has a drone. The last is the one who is revoked.
  const std::vector<Member> hosts{issue(first, "host0", "client"), issue(first, "host1", "client"),
                                  issue(first, "leaver", "client")};
  const Member foreigner = issue(second, "pilot", "client"), outsider = issue(impostors, "host0", "client"),
               expired = issue(first, "old", "client", 1);
  /// Certificates of the organisation's own endorser, used one after the other; and one that ends early.
  const std::vector<Member> endorsers{issue(first, "endorser0", "peer"), issue(first, "endorser1", "peer"),
                                      issue(first, "endorser2", "peer")};
  const Member brief_endorser = issue(first, "endorser9", "peer", 4), false_endorser = issue(impostors, "x", "peer");
};
const People& people();

/// A stock peer: it takes each block at once, validates it, and answers proposals in the name of the three
/// organisations' peers. Apart from the contract and the one validator of transactions it shares nothing with the
/// endorser.
class StockPeer {
 public:
  StockPeer();
  /// Validates and takes the block; writes its flags into it.
  std::vector<int> take(common::Block& block);
  /// Its organisation approves what is defined.
  void approve() { approved_ = definition_.sequence; }
  bool approves() const { return approved_ == definition_.sequence; }
  std::uint64_t height() const { return ledger_.height(); }
  const node::ChainEnd& end() const { return ledger_.end(); }
  const node::State& state() const { return ledger_.state(); }
  node::Reply process_proposal(const std::string& signed_proposal, node::Now now) {
    return endorser_.process_proposal(signed_proposal, now, 0);
  }
  /// Endorsed by all three.
  node::Reply endorse(const std::string& signed_proposal, node::Now now) {
    return endorser_.endorse(signed_proposal, now);
  }

 private:
  const node::CoreConfig config_;
  fabric::KeyState key_state_;
  std::unique_ptr<crypto::MspRegistry> members_;
  node::Ledger ledger_;
  node::Definition definition_;
  std::optional<node::Version> approved_;
  node::Endorser endorser_;
};

/// The orderer with the peer behind it: what is ordered comes into the next block.
class Channel {
 public:
  Channel();
  /// Code of each transaction in the block, in its order.
  std::vector<int> cut(const std::vector<std::string>& envelopes);
  void revoke(const fabric::Organisation& organisation, const Member& member);
  /// A new definition of the contract, of the next version.
  void define();
  /// Another block in the place of block `number`, by `orderer`; it follows what is named `previous_hash`.
  std::string other_block(std::uint64_t number, const std::string& previous_hash, const Member& orderer) const;

  StockPeer peer;
  std::vector<std::string> blocks;      ///< common.Block each, with the peer's flags
  std::vector<std::vector<int>> codes;  ///< the same
  int version = 0;

 private:
  std::vector<int> add(const std::vector<std::string>& envelopes, bool config);
  void configure();

  std::vector<std::pair<std::string, std::string>> revoked_;  ///< MSP id and list
  std::uint64_t last_config_ = 0;
  int drafts_ = 0;
};

}  // namespace ledgerline::endorser
