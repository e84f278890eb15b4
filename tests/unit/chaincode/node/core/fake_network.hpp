#pragma once
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "chaincode/node/core/node_core.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::node {

/// A core with test identities and a clock that the test moves; what it commits is kept in `chain`.
class FakeNetwork {
 public:
  explicit FakeNetwork(CoreConfig settings = {}) : config(std::move(settings)) { restart(); }

  /// A core without memory; replays what is in `chain`.
  void restart() {
    const std::vector<std::string> msp_ids{"Org1MSP", "Org2MSP", "Org3MSP"};
    std::vector<crypto::SigningIdentity> peers;
    for (const std::string& id : msp_ids) peers.push_back(crypto::make_test_identity({id, "CN=peer0"}));
    config.organisations.clear();
    for (const std::string& id : msp_ids) config.organisations.push_back({id, "ca of " + id});
    core = std::make_unique<NodeCore>(config, crypto::make_test_registry(msp_ids), peers,
                                      crypto::make_test_identity({"OrdererMSP", "CN=orderer"}),
                                      [this](std::uint64_t number) -> Result<std::string> {
                                        if (number < chain.size()) return chain[number];
                                        return Error{"no such block"};
                                      });
    for (const std::string& block : chain) ASSERT_TRUE(core->replay(block).ok());
    if (chain.empty()) keep(core->genesis());
  }

  std::vector<WaiterAnswer> keep(const CutBlock& block) {
    EXPECT_EQ(block.number, chain.size());
    chain.push_back(block.bytes);
    return core->apply(block);
  }

  fabric::Proposal propose(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg) {
    const std::string nonce = "nonce " + std::to_string(++nonces) + std::string(24, '.');
    return *fabric::make_proposal(who, {}, {function, {arg}}, now.real_ns, nonce.substr(0, 24));
  }

  /// Endorsed and signed, ready for order().
  std::string endorsed(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg) {
    const Reply reply = core->endorse(propose(who, function, arg).signed_proposal, now);
    EXPECT_EQ(reply.code, Code::ok) << reply.detail;
    return *fabric::sign_envelope(who, reply.bytes);
  }

  /// Cuts and keeps everything that is due; the codes of all transactions.
  std::vector<int> commit() {
    std::vector<int> codes;
    while (const auto block = core->cut(now)) {
      keep(*block);
      for (const TxStatus& status : block->transactions) codes.push_back(status.code);
    }
    return codes;
  }

  std::vector<int> submit(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg) {
    EXPECT_EQ(core->order(endorsed(who, function, arg), now).code, Code::ok);
    return commit();
  }

  fabric::Block block(std::size_t number) { return *fabric::decode_block(chain.at(number)); }

  CoreConfig config;
  Now now{ns_per_s, 1'700'000'000 * ns_per_s};
  std::unique_ptr<NodeCore> core;
  std::vector<std::string> chain;
  int nonces = 0;
  const crypto::SigningIdentity admin1 = crypto::make_test_identity({"Org1MSP", "CN=Admin"});
  const crypto::SigningIdentity admin2 = crypto::make_test_identity({"Org2MSP", "CN=Admin"});
  const crypto::SigningIdentity host = crypto::make_test_identity({"Org1MSP", "CN=host"});
  const crypto::SigningIdentity pilot = crypto::make_test_identity({"Org2MSP", "CN=pilot"});
};

inline std::string enroll_call(const crypto::IdentityName& who, const std::vector<std::string>& drones,
                               Role role = ROLE_NONE) {
  EnrollCall call;
  call.mutable_identity()->set_msp_id(who.msp_id);
  call.mutable_identity()->set_subject(who.subject);
  for (const std::string& drone : drones) call.add_drones(drone);
  call.set_role(role);
  return call.SerializeAsString();
}

/// Opens drones to an organisation's operators without a bound.
inline std::string grant_call(const std::string& msp_id, const std::vector<std::string>& drones) {
  GrantCall call;
  for (const std::string& drone : drones) call.add_drones(drone);
  call.mutable_grant()->mutable_to()->set_msp_id(msp_id);
  call.mutable_grant()->set_fly(true);
  call.mutable_grant()->set_max_priority(contract::max_priority);
  return call.SerializeAsString();
}

inline std::string note(const std::string& id, const std::string& data = "data") {
  SetCall call;
  call.add_assets()->set_id(id);
  call.mutable_assets(0)->set_msg_type("std_msgs/msg/String");
  call.mutable_assets(0)->set_msg_data(data);
  return call.SerializeAsString();
}

}  // namespace ledgerline::node
