#pragma once
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "chaincode/node/core/node_core.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "tests/unit/common/fabric/validation/signed_chain.hpp"

/// The embedded node's core with real certificates of three organisations, and its chain.
namespace ledgerline::fabric {

class SignedNode {
 public:
  SignedNode() {
    node::CoreConfig config;
    config.batch_count = 1'000;  // a block is what commit() is called for
    for (const Organisation& one : organisations) {
      config.organisations.push_back(one.root());
      peers.push_back(one.member("peer"));
    }
    config.orderers = orderers.root();
    core = std::make_unique<node::NodeCore>(config, crypto::make_msp_registry(library, config.organisations), peers,
                                            orderer, [this](std::uint64_t number) -> Result<std::string> {
                                              if (number < chain.size()) return chain[number];
                                              return Error{"no such block"};
                                            });
    keep(core->genesis());
  }

  Proposal propose(const crypto::SigningIdentity& who, const Call& call, const ChannelAndContract& where = {}) const {
    return *make_proposal(who, where, call, now.real_ns, crypto::random_bytes(24));
  }
  /// Signs what the peers endorsed; it is for the next block.
  void order(const crypto::SigningIdentity& who, const std::string& endorsed) {
    const auto ordered = core->order(*sign_envelope(who, endorsed), now);
    EXPECT_EQ(ordered.code, node::Code::ok) << ordered.message << ordered.detail;
  }
  /// All that was ordered is in the next block.
  void commit() {
    now.monotonic_ns += ns_per_s;
    const auto block = core->cut(now);
    ASSERT_TRUE(block);
    keep(*block);
  }

  const std::vector<Organisation> organisations{Organisation("Org1MSP"), Organisation("Org2MSP"),
                                                Organisation("Org3MSP")};
  const Organisation orderers{"OrdererMSP"};
  const crypto::SigningIdentity orderer = orderers.member("orderer");
  std::vector<crypto::SigningIdentity> peers;
  std::vector<std::string> chain;
  node::Now now{ns_per_s, realtime_ns()};
  std::unique_ptr<node::NodeCore> core;

 private:
  void keep(const node::CutBlock& block) {
    chain.push_back(block.bytes);
    core->apply(block);
  }
};

}  // namespace ledgerline::fabric
