#pragma once
#include <string>
#include <vector>

#include "common/base/random.hpp"
#include "common/fabric/receipt/receipt.hpp"
#include "common/fabric/receipt/receipt_verifier.hpp"
#include "tests/unit/chaincode/node/core/fake_network.hpp"
#include "tests/unit/common/fabric/validation/signed_node.hpp"

/// A ledger whose transactions have receipts.
namespace ledgerline::fabric {

class LedgerOfReceipts : public SignedNode {
 public:
  struct Sent {
    std::string tx_id;
    std::uint64_t block = 0;
    int code = -1;
  };

  LedgerOfReceipts() {
    for (const Organisation& one : organisations) users.push_back(one.member("client"));
  }

  /// Writes something as a user of an organisation; `majority`: endorsed as it has to be, else by one peer alone.
  Sent send(std::size_t organisation, const std::string& data, bool majority = true) {
    const std::string id = organisations[organisation].msp_id + "/notes" + std::to_string(++notes_);
    const Proposal proposal = propose(users[organisation], {"set", {node::note(id, data)}});
    order(users[organisation],
          majority ? core->endorse(proposal.signed_proposal, now).bytes
                   : *assemble(proposal, {core->process_proposal(proposal.signed_proposal, now, organisation).bytes}));
    return {proposal.tx_id, chain.size(), -1};
  }
  /// One alone in its block.
  Sent committed(std::size_t organisation, const std::string& data, bool majority = true) {
    Sent sent = send(organisation, data, majority);
    commit();
    sent.code = core->find(sent.tx_id)->code;
    return sent;
  }

  std::string question(const std::string& tx_id, const std::string& function = verdict_function,
                       const std::string& contract = chain_contract) {
    return propose(users[0], {function, {"teleop", tx_id}}, {"teleop", contract}).signed_proposal;
  }
  PeerAnswer answer(const std::string& question, std::size_t peer) {
    return {"peer" + std::to_string(peer + 1), core->process_proposal(question, now, peer).bytes};
  }
  Result<Receipt> make(const Sent& sent) {
    const std::string asked = question(sent.tx_id);
    return make_receipt("teleop", sent.tx_id, chain.at(sent.block), asked,
                        {answer(asked, 2), answer(asked, 0), answer(asked, 1)});
  }
  Receipt receipt(const Sent& sent) {
    auto made = make(sent);
    EXPECT_TRUE(made) << made.error().message;
    return *made;
  }

  ReceiptTrust trust() const {
    ReceiptTrust trust{"teleop", {}, {orderers.root()}};
    for (const Organisation& one : organisations) trust.organisations.push_back(one.root());
    return trust;
  }
  ReceiptVerifier make_verifier() const { return std::move(ReceiptVerifier::from(trust())).value(); }

  std::vector<crypto::SigningIdentity> users;

 private:
  int notes_ = 0;
};

}  // namespace ledgerline::fabric
