#pragma once
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "chaincode/node/core/core.hpp"
#include "common/base/random.hpp"
#include "common/fabric/receipt/receipt.hpp"
#include "common/fabric/receipt/receipt_judge.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "tests/unit/chaincode/node/core/fake_network.hpp"
#include "tests/unit/common/fabric/judge/signed_chain.hpp"

/// The embedded node's core with real certificates of three organisations, for tests of receipts.
namespace ledgerline::fabric {

class LedgerOfReceipts {
 public:
  struct Sent {
    std::string tx_id;
    std::uint64_t block = 0;
    int code = -1;
  };

  LedgerOfReceipts() {
    node::CoreConfig config;
    config.batch_count = 1'000;  // a block is what commit() is called for
    for (const Organisation& one : organisations_) {
      config.organisations.push_back(one.root());
      peers_.push_back(one.member("peer"));
      users_.push_back(one.member("client"));
    }
    config.orderers = orderers_.root();
    core_ = std::make_unique<node::NodeCore>(config, crypto::make_msp_registry(library, config.organisations), peers_,
                                             orderer_, [this](std::uint64_t number) -> Result<std::string> {
                                               if (number < chain_.size()) return chain_[number];
                                               return Error{"no such block"};
                                             });
    keep(core_->genesis());
  }

  /// Writes something as a user of an organisation; `majority`: endorsed as it has to be, else by one peer alone.
  Sent send(std::size_t organisation, const std::string& data, bool majority = true) {
    const std::string id = organisations_[organisation].msp_id + "/notes" + std::to_string(++notes_);
    const auto proposal = *make_proposal(users_[organisation], {}, {"set", {node::note(id, data)}}, now_.real_ns,
                                         crypto::random_bytes(24));
    std::string envelope;
    if (majority) {
      envelope = core_->endorse(proposal.signed_proposal, now_).bytes;
    } else {
      envelope = *assemble(proposal, {core_->process_proposal(proposal.signed_proposal, now_, organisation).bytes});
    }
    const auto ordered = core_->order(*sign_envelope(users_[organisation], envelope), now_);
    EXPECT_EQ(ordered.code, node::Code::ok) << ordered.message << ordered.detail;
    return {proposal.tx_id, chain_.size(), -1};
  }
  /// All that was sent is in the next block.
  void commit() {
    now_.monotonic_ns += ns_per_s;
    const auto block = core_->cut(now_);
    ASSERT_TRUE(block);
    keep(*block);
  }
  /// One alone in its block.
  Sent committed(std::size_t organisation, const std::string& data, bool majority = true) {
    Sent sent = send(organisation, data, majority);
    commit();
    sent.code = core_->find(sent.tx_id)->code;
    return sent;
  }

  std::string question(const std::string& tx_id, const std::string& function = verdict_function,
                       const std::string& contract = chain_contract) {
    return make_proposal(users_[0], {"teleop", contract}, {function, {"teleop", tx_id}}, now_.real_ns,
                         crypto::random_bytes(24))
        ->signed_proposal;
  }
  PeerAnswer answer(const std::string& question, std::size_t peer) {
    return {"peer" + std::to_string(peer + 1), core_->process_proposal(question, now_, peer).bytes};
  }
  Result<Receipt> make(const Sent& sent) {
    const std::string asked = question(sent.tx_id);
    return make_receipt("teleop", sent.tx_id, chain_.at(sent.block), asked,
                        {answer(asked, 2), answer(asked, 0), answer(asked, 1)});
  }
  Receipt receipt(const Sent& sent) {
    auto made = make(sent);
    EXPECT_TRUE(made) << made.error().what;
    return *made;
  }

  ReceiptTrust trust() const {
    ReceiptTrust trust{"teleop", {}, {orderers_.root()}};
    for (const Organisation& one : organisations_) trust.organisations.push_back(one.root());
    return trust;
  }
  ReceiptJudge judge() const { return std::move(ReceiptJudge::from(trust())).value(); }

  const std::vector<Organisation> organisations_{Organisation("Org1MSP"), Organisation("Org2MSP"),
                                                 Organisation("Org3MSP")};
  const Organisation orderers_{"OrdererMSP"};
  const crypto::SigningIdentity orderer_ = orderers_.member("orderer");
  std::vector<crypto::SigningIdentity> peers_, users_;
  std::vector<std::string> chain_;
  node::Now now_{ns_per_s, realtime_ns()};

 private:
  void keep(const node::CutBlock& block) {
    chain_.push_back(block.bytes);
    core_->apply(block);
  }

  std::unique_ptr<node::NodeCore> core_;
  int notes_ = 0;
};

}  // namespace ledgerline::fabric
