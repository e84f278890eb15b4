#pragma once
#include <string>
#include <vector>

#include "tests/unit/chaincode/node/core/fake_network.hpp"
#include "tests/unit/common/fabric/validation/signed_node.hpp"
#include "tools/audit/chain_audit.hpp"

/// A short history of a drone on a ledger of three organisations.
namespace ledgerline::audit {

class SignedLedger : public fabric::SignedNode {
 public:
  /// Endorsed and signed, for the next block; its transaction's id.
  std::string send(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg) {
    now.real_ns += 20 * ns_per_ms;
    const fabric::Proposal proposal = propose(who, {function, {arg}});
    const node::Reply reply = core->endorse(proposal.signed_proposal, now);
    EXPECT_EQ(reply.code, node::Code::ok) << function << ": " << reply.message << reply.detail;
    order(who, reply.bytes);
    return proposal.tx_id;
  }
  std::string submit(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg) {
    const std::string tx_id = send(who, function, arg);
    commit();
    return tx_id;
  }

  /// tello1 is Org1's host's, and Org2's pilot is an operator who may fly it.
  void enroll() {
    submit(admin1, "enroll", node::enroll_call(host.name, {"tello1"}));
    submit(admin1, "grant", node::grant_call("Org2MSP", {"tello1"}));
    submit(admin2, "enroll", node::enroll_call(pilot.name, {}, OPERATOR));
  }
  std::string acquire() {
    LeaseCall call;
    call.add_drones("tello1");
    return submit(pilot, "acquire", call.SerializeAsString());
  }
  std::string command_call(std::uint64_t sequence, std::uint64_t epoch, TimeNs state_stamp_ns,
                           Action action = FLY) const {
    CommandCall call;
    call.set_organisation("Org1MSP");
    DronePlan& plan = *call.add_plans();
    plan.set_drone("tello1");
    plan.set_action(action);
    plan.set_boot_id(7);
    plan.set_state_stamp_ns(state_stamp_ns);
    plan.set_sequence(sequence);
    plan.set_epoch(epoch);
    if (action == FLY) plan.add_setpoints()->set_at_ns(state_stamp_ns + 100 * ns_per_ms);
    return call.SerializeAsString();
  }
  static std::string drones_call(bool cut = false) {
    DronesCall call;
    call.add_drones("tello1");
    call.set_cut(cut);
    return call.SerializeAsString();
  }

  Trust trust() const { return {"teleop", chain.at(0)}; }

  const crypto::SigningIdentity admin1 = named(0, "admin"), admin2 = named(1, "admin"), host = named(0, "client"),
                                pilot = named(1, "client");

 private:
  /// Under the name that its certificate has.
  crypto::SigningIdentity named(std::size_t organisation, const std::string& unit) const {
    crypto::SigningIdentity identity = organisations[organisation].member(unit);
    msp::SerializedIdentity serialized;
    EXPECT_TRUE(serialized.ParseFromString(identity.serialized));
    identity.name.subject = crypto::parse_certificate(serialized.id_bytes())->subject;
    return identity;
  }
};

inline ChainAudit audited(const std::vector<std::string>& chain, Trust trust, TimeSpan span = {}) {
  auto audit = ChainAudit::start(std::move(trust), span);
  EXPECT_TRUE(audit) << audit.error().message;
  for (const std::string& block : chain) audit->add(block);
  audit->end();
  return std::move(*audit);
}

}  // namespace ledgerline::audit
