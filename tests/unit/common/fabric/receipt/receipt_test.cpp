#include "common/fabric/receipt/receipt.hpp"

#include <gmock/gmock.h>

#include <functional>
#include <map>

#include "common/fabric/tx/envelope.hpp"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"
#include "tests/unit/campaign.hpp"
#include "tests/unit/common/crypto/revocation_list.hpp"
#include "tests/unit/common/fabric/receipt/ledger_of_receipts.hpp"

/// Receipts, by who makes them honestly and by who would like to have another one.
namespace ledgerline::fabric {
namespace {

using ::testing::HasSubstr;

class ReceiptTest : public ::testing::Test, protected LedgerOfReceipts {
 protected:
  std::string why(const Receipt& receipt) const { return why(receipt_bytes(receipt)); }
  std::string why(const std::string& bytes) const {
    const auto proven = verifier_.verify(bytes);
    return proven ? "" : proven.error().message;
  }
  /// Signs an answer, which a peer's key can do with whatever it likes.
  static void sign(Receipt::Answer& answer, const crypto::SigningIdentity& who) {
    answer.endorsement.signer = who.serialized;
    answer.endorsement.signature = *who.signer->sign(answer.payload + who.serialized);
  }
  static void say(Receipt::Answer& answer, const std::function<void(protos::ProcessedTransaction&)>& lie) {
    protos::ProposalResponsePayload payload;
    protos::ChaincodeAction action;
    protos::ProcessedTransaction said;
    ASSERT_TRUE(payload.ParseFromString(answer.payload) && action.ParseFromString(payload.extension()) &&
                said.ParseFromString(action.response().payload()));
    lie(said);
    action.mutable_response()->set_payload(said.SerializeAsString());
    payload.set_extension(action.SerializeAsString());
    answer.payload = payload.SerializeAsString();
  }
  static void say_code(Receipt::Answer& answer, int code) {
    say(answer, [code](protos::ProcessedTransaction& said) { said.set_validationcode(code); });
  }

  static void say_response(Receipt::Answer& answer, const std::function<void(protos::ChaincodeAction&)>& lie) {
    protos::ProposalResponsePayload payload;
    protos::ChaincodeAction action;
    ASSERT_TRUE(payload.ParseFromString(answer.payload) && action.ParseFromString(payload.extension()));
    lie(action);
    payload.set_extension(action.SerializeAsString());
    answer.payload = payload.SerializeAsString();
  }
  /// Another block in place of the receipt's, and every key of the network lies with it: what is left to hold against
  /// it is what the creators signed.
  Receipt conspire(Receipt receipt, const std::vector<std::string>& envelopes) const {
    std::string all;
    for (const std::string& one : envelopes) all += one;
    const crypto::Digest digest = crypto::sha256(all);
    Receipt::Block& block = receipt.block;
    block.data = envelopes;
    block.data_hash.assign(digest.begin(), digest.end());
    const std::string& signer = block.orderers[0].signer;
    block.orderers[0].signature = *orderer.signer->sign(
        block.orderers_value + signer + block_header_bytes(block.number, block.previous_hash, block.data_hash));
    for (std::size_t i = 0; i < receipt.answers.size(); ++i) {
      say(receipt.answers[i], [&](protos::ProcessedTransaction& said) {
        said.mutable_transactionenvelope()->ParseFromString(envelopes[0]);
      });
      sign(receipt.answers[i], peers[i]);
    }
    return receipt;
  }

  const ReceiptVerifier verifier_ = make_verifier();
};

/// A transaction with something changed in it, signed again by `who`.
std::string altered(const std::string& envelope, const crypto::SigningIdentity& who,
                    const std::function<void(OpenedTransaction&, common::ChannelHeader&)>& alter) {
  auto opened = *open_transaction(envelope);
  common::ChannelHeader header;
  EXPECT_TRUE(header.ParseFromString(opened.payload.header().channel_header()));
  alter(opened, header);
  opened.payload.mutable_header()->set_channel_header(header.SerializeAsString());
  return *sign_envelope(who, opened.bytes());
}

TEST_F(ReceiptTest, ItProvesBlockCreatorCallAndVerdictAndSaysByWhoseWord) {
  const Sent other = send(1, "somebody else's");
  Sent sent = send(0, "mine");
  commit();
  const auto proven = verifier_.verify(receipt_bytes(receipt(sent)));
  ASSERT_TRUE(proven) << proven.error().message;
  EXPECT_EQ(proven->channel, "teleop");
  EXPECT_EQ(proven->tx_id, sent.tx_id);
  EXPECT_EQ(proven->block, 1U);
  ASSERT_EQ(proven->orderers.size(), 1U);
  EXPECT_EQ(proven->orderers[0].msp_id, "OrdererMSP");
  EXPECT_EQ(proven->creator.msp_id, "Org1MSP");
  EXPECT_THAT(proven->creator.subject, HasSubstr("CN=client.Org1MSP"));
  EXPECT_EQ(proven->contract, "ledgerline");
  EXPECT_EQ(proven->function, "set");
  EXPECT_THAT(proven->arguments, testing::ElementsAre(node::note("Org1MSP/notes2", "mine")));
  EXPECT_EQ(proven->timestamp_ns, now.real_ns);
  EXPECT_EQ(proven->endorsers.size(), 3U);
  EXPECT_EQ(proven->code, protos::VALID);
  EXPECT_EQ(proven->verdict, "VALID");
  ASSERT_EQ(proven->peers.size(), 3U);
  EXPECT_EQ(proven->peers[2].msp_id, "Org3MSP");
  EXPECT_EQ(proven->organisations, 3U);
  ASSERT_EQ(proven->others.size(), 1U);
  EXPECT_EQ(proven->others[0].tx_id, other.tx_id);
  EXPECT_EQ(proven->others[0].creator.msp_id, "Org2MSP");
}

TEST_F(ReceiptTest, TheBlocksHashIsTheOneThatTheNextBlockNames) {
  const Sent sent = committed(0, "first");
  committed(1, "second");
  const auto proven = verifier_.verify(receipt_bytes(receipt(sent)));
  ASSERT_TRUE(proven) << proven.error().message;
  EXPECT_EQ(proven->block_hash, crypto::hex(decode_block(chain[2])->previous_hash));
}

TEST_F(ReceiptTest, WhatWasRefusedIsProvenToBeInvalid) {
  const Sent sent = committed(0, "by one peer alone", false);
  ASSERT_EQ(sent.code, protos::ENDORSEMENT_POLICY_FAILURE);
  const auto proven = verifier_.verify(receipt_bytes(receipt(sent)));
  ASSERT_TRUE(proven) << proven.error().message;
  EXPECT_EQ(proven->verdict, "ENDORSEMENT_POLICY_FAILURE");
  EXPECT_EQ(proven->endorsers.size(), 1U);
}

TEST_F(ReceiptTest, AMajorityIsEnoughAndLessIsNot) {
  Receipt two = receipt(committed(0, "x"));
  two.answers.erase(two.answers.begin());
  EXPECT_EQ(why(two), "");
  two.answers.erase(two.answers.begin());
  EXPECT_THAT(why(two), HasSubstr("by peers of 1 of 3 organisations, which is no majority"));
  two.answers.clear();
  EXPECT_THAT(why(two), HasSubstr("0 of 3"));
}

TEST_F(ReceiptTest, NothingOfItCanBeAnotherThing) {
  const Sent other = send(1, "other");
  const Sent sent = send(0, "mine");
  commit();
  const Receipt elsewhere = receipt(committed(0, "elsewhere"));
  const Receipt good = receipt(sent);
  ASSERT_EQ(why(good), "");
  struct Lie {
    const char* name;
    std::function<void(Receipt&)> tell;
    const char* why;
  };
  const std::vector<Lie> lies{
      {"channel", [](Receipt& r) { r.channel = "other"; }, "of channel other, not of teleop"},
      {"id", [&](Receipt& r) { r.tx_id = other.tx_id; }, "not asked for this transaction's verdict"},
      {"no such id", [](Receipt& r) { r.tx_id[0] = 'x'; }, "it is not in block 1"},
      {"number", [](Receipt& r) { ++r.block.number; }, "is not of this block"},
      {"previous hash", [](Receipt& r) { r.block.previous_hash[3] ^= 1; }, "is not of this block"},
      {"data hash", [](Receipt& r) { r.block.data_hash[3] ^= 1; }, "does not match its data hash"},
      {"another block", [&](Receipt& r) { r.block = elsewhere.block; }, "it is not in block 2"},
      {"a transaction left out", [](Receipt& r) { r.block.data.pop_back(); }, "does not match its data hash"},
      {"two run together", [](Receipt& r) { r.block.data = {r.block.data[0] + r.block.data[1]}; },
       "what no orderer puts into a block"},
      {"an empty one between", [](Receipt& r) { r.block.data.insert(r.block.data.begin(), ""); },
       "what no orderer puts into a block"},
      {"no orderer", [](Receipt& r) { r.block.orderers.clear(); }, "no orderer has signed it"},
      {"an orderer twice", [](Receipt& r) { r.block.orderers.push_back(r.block.orderers[0]); }, "signed it twice"},
      {"what orderers signed", [](Receipt& r) { r.block.orderers_value += "x"; }, "is not of this block"},
      {"another orderers' word", [&](Receipt& r) { r.block.orderers = elsewhere.block.orderers; },
       "is not of this block"},
      {"question", [&](Receipt& r) { r.question = elsewhere.question; }, "not asked for this transaction's verdict"},
      {"no question", [](Receipt& r) { r.question.clear(); }, "not asked for this transaction's verdict"},
      {"answer", [&](Receipt& r) { r.answers[1] = elsewhere.answers[1]; }, "answers another question"},
      {"code", [](Receipt& r) { say_code(r.answers[0], 11); }, "has a signature that is not its own"},
      {"answers of one organisation", [](Receipt& r) { r.answers[1] = r.answers[0]; }, "not the only one"},
      {"order of answers", [](Receipt& r) { std::swap(r.answers[0], r.answers[1]); }, "not at its place"},
      {"who answered", [](Receipt& r) { r.answers[0].endorsement.signer = r.answers[1].endorsement.signer; },
       "has a signature that is not its own"},
  };
  for (const Lie& lie : lies) {
    Receipt bent = good;
    lie.tell(bent);
    EXPECT_THAT(why(bent), HasSubstr(lie.why)) << lie.name;
  }
}

TEST_F(ReceiptTest, APeersKeyIsNotEnoughForALie) {
  const Sent sent = committed(0, "mine");
  const Receipt good = receipt(sent), elsewhere = receipt(committed(0, "elsewhere"));
  Receipt bent = good;
  say_code(bent.answers[1], protos::MVCC_READ_CONFLICT);
  sign(bent.answers[1], peers[1]);
  EXPECT_THAT(why(bent), HasSubstr("the peers differ: Org1MSP says VALID, Org2MSP says MVCC_READ_CONFLICT"));

  bent = good;  // with the answer of a peer of two organisations beside a made-up one
  say(bent.answers[0], [&](protos::ProcessedTransaction& said) {
    said.mutable_transactionenvelope()->ParseFromString(elsewhere.block.data[0]);
  });
  sign(bent.answers[0], peers[0]);
  EXPECT_THAT(why(bent), HasSubstr("Org1MSP"));
  EXPECT_THAT(why(bent), HasSubstr("is about another transaction than the one in the block"));

  bent = good;
  say_response(bent.answers[0], [](auto& action) { action.mutable_chaincode_id()->set_name("ledgerline"); });
  sign(bent.answers[0], peers[0]);
  EXPECT_THAT(why(bent), HasSubstr("it is not of qscc")) << "a contract answers whatever it likes";
  bent = good;
  say_response(bent.answers[0], [](auto& action) { action.mutable_response()->set_status(500); });
  sign(bent.answers[0], peers[0]);
  EXPECT_THAT(why(bent), HasSubstr("it is a refusal"));
}

TEST_F(ReceiptTest, WhatItsCreatorHasNotSignedIsNotProvenByAnybodyElse) {
  const Sent sent = committed(0, "mine");
  const Receipt good = receipt(sent);
  const std::string& mine = good.block.data[0];
  ASSERT_EQ(why(conspire(good, {mine})), "");
  const auto nothing = [](OpenedTransaction&, common::ChannelHeader&) {};
  const auto refusal = [&](const std::string& envelope) { return why(conspire(good, {envelope})); };
  EXPECT_THAT(refusal(altered(mine, users[1], nothing)), HasSubstr("its creator's signature is wrong"));
  EXPECT_THAT(refusal(altered(mine, users[0],
                              [](OpenedTransaction& one, auto&) {
                                common::SignatureHeader header;
                                header.ParseFromString(one.payload.header().signature_header());
                                header.set_nonce("another");
                                one.payload.mutable_header()->set_signature_header(header.SerializeAsString());
                              })),
              HasSubstr("its id is not of its creator"));
  EXPECT_THAT(refusal(altered(mine, users[0], [](auto&, auto& header) { header.set_channel_id("other"); })),
              HasSubstr("block 1: it is of channel other, not of teleop"));
  EXPECT_THAT(refusal(altered(mine, users[0], [](auto&, auto& header) { header.set_type(common::CONFIG); })),
              HasSubstr("it is a configuration of the channel"));
  const std::string elsewhere = altered(mine, users[0], [](auto&, auto& header) {
    header.set_channel_id("other");
    header.set_tx_id("another one's");
  });
  EXPECT_THAT(why(conspire(good, {mine, elsewhere})), HasSubstr("of channel other"));
}

TEST_F(ReceiptTest, AnEndorsementCountsOnlyByAPeersKeyAndForThisCall) {
  const Sent sent = committed(0, "mine");
  const Receipt good = receipt(sent);
  const std::string& mine = good.block.data[0];
  const auto endorsed = [&](const std::function<void(OpenedTransaction&, common::ChannelHeader&)>& alter) {
    return why(conspire(good, {altered(mine, users[0], alter)}));
  };
  const auto by = [](OpenedTransaction& one, const crypto::SigningIdentity& who) {
    one.seal_result();
    auto& action = *one.action.mutable_action();
    action.clear_endorsements();
    auto& endorsement = *action.add_endorsements();
    endorsement.set_endorser(who.serialized);
    endorsement.set_signature(*who.signer->sign(action.proposal_response_payload() + who.serialized));
  };
  const std::string none = "the peers call it valid, and no endorsement of it is good";
  EXPECT_EQ(endorsed([&](auto& one, auto&) { by(one, peers[1]); }), "");
  EXPECT_EQ(endorsed([](auto& one, auto&) { one.action.mutable_action()->clear_endorsements(); }), none);
  EXPECT_EQ(endorsed([&](auto& one, auto&) { by(one, users[1]); }), none) << "no peer";
  EXPECT_EQ(endorsed([&](auto& one, auto&) { by(one, Organisation("Org1MSP").member("peer")); }), none);
  EXPECT_EQ(endorsed([&](auto& one, auto&) {
              by(one, peers[1]);
              one.action.mutable_action()->mutable_endorsements(0)->set_endorser(peers[2].serialized);
            }),
            none);
  EXPECT_EQ(endorsed([&](auto& one, auto&) {
              one.response.set_proposal_hash("of another call");
              by(one, peers[1]);
            }),
            none);
}

TEST_F(ReceiptTest, OnlyPeersAndOrderersCount) {
  const Receipt good = receipt(committed(0, "mine"));
  Receipt bent = good;
  sign(bent.answers[0], users[0]);
  EXPECT_THAT(why(bent), HasSubstr("it is not of a peer"));
  const Organisation impostor("Org1MSP");  // the same name, another authority
  sign(bent.answers[0], impostor.member("peer"));
  EXPECT_THAT(why(bent), HasSubstr("who answered is no peer of the organisations that you named"));

  const auto order = [&](const crypto::SigningIdentity& who) {
    common::SignatureHeader header;
    header.set_creator(who.serialized);
    header.set_nonce("n");
    const auto& block = good.block;
    const std::string signer = header.SerializeAsString();
    Receipt receipt = good;
    receipt.block.orderers = {
        {signer, *who.signer->sign(block.orderers_value + signer +
                                   block_header_bytes(block.number, block.previous_hash, block.data_hash))}};
    return why(receipt);
  };
  EXPECT_EQ(order(orderers.member("orderer")), "");
  EXPECT_THAT(order(orderers.member("client")), HasSubstr("signed it and is no orderer"));
  EXPECT_THAT(order(peers[0]), HasSubstr("no orderer that you named"));
  EXPECT_THAT(order(Organisation("OrdererMSP").member("orderer")), HasSubstr("no orderer that you named"));
}

TEST_F(ReceiptTest, OnlyWhoChecksSaysWhomToTrust) {
  const std::string bytes = receipt_bytes(receipt(committed(2, "mine")));
  const auto refusal = [&](const std::function<void(ReceiptTrust&)>& change) {
    ReceiptTrust other = trust();
    change(other);
    const auto verifier = ReceiptVerifier::from(std::move(other));
    if (!verifier) return verifier.error().message;
    const auto proven = verifier->verify(bytes);
    return proven ? std::string() : proven.error().message;
  };
  EXPECT_EQ(refusal([](auto&) {}), "");
  EXPECT_THAT(refusal([](auto& t) { t.channel = "other"; }), HasSubstr("of channel teleop, not of other"));
  EXPECT_THAT(refusal([](auto& t) { t.channel.clear(); }), HasSubstr("the channel's name is missing"));
  EXPECT_THAT(refusal([](auto& t) { t.organisations.pop_back(); }), HasSubstr("its creator is nobody of"));
  EXPECT_THAT(refusal([](auto& t) { t.organisations.clear(); }), HasSubstr("no authority of the organisations"));
  EXPECT_THAT(refusal([](auto& t) { t.orderers = {t.organisations[0]}; }), HasSubstr("no orderer that you named"));
  EXPECT_THAT(refusal([](auto& t) { t.orderers[0].ca_pem = "no certificate"; }), HasSubstr("OrdererMSP"));
  EXPECT_THAT(refusal([](auto& t) {
                for (const char* more : {"A", "B", "C"}) t.organisations.push_back({more, t.organisations[0].ca_pem});
              }),
              HasSubstr("3 of 6 organisations, which is no majority"));
  EXPECT_EQ(refusal([](auto& t) { t.organisations.push_back(t.organisations[0]); }), "") << "named twice is one";
}

std::string certificate_of(const crypto::SigningIdentity& who) {
  msp::SerializedIdentity serialized;
  EXPECT_TRUE(serialized.ParseFromString(who.serialized));
  return serialized.id_bytes();
}

TEST_F(ReceiptTest, ARevokedOrdererOrPeerNoLongerCounts) {
  const Receipt good = receipt(committed(0, "mine"));
  Receipt two = good;
  two.answers.pop_back();
  const auto said = [&](const Receipt& receipt, const std::string& lists) {
    ReceiptTrust with = trust();
    with.revocation_lists_pem = lists;
    const auto verifier = ReceiptVerifier::from(std::move(with));
    return verifier ? verifier->verify(receipt_bytes(receipt)) : verifier.error();
  };
  const auto list = [](const Organisation& of, const crypto::SigningIdentity& who) {
    return crypto::list_of(of.ca, certificate_of(who), crypto::NamedKey::none);
  };
  const std::string peer1 = list(organisations[0], peers[0]), user2 = list(organisations[1], users[1]);
  const std::string user1 = list(organisations[0], users[0]);

  const auto most = said(good, peer1);
  ASSERT_TRUE(most) << most.error().message;
  EXPECT_EQ(most->peers.size(), 2U) << "not counted";
  EXPECT_EQ(most->verdict, "VALID");
  EXPECT_THAT(
      said(two, peer1).error().message,
      HasSubstr("peers of 1 of 3 organisations, which is no majority; revoked, so not counted: Org1MSP CN=peer"));
  EXPECT_TRUE(said(two, user2)) << "somebody else's revocation";
  Receipt spoilt = good;
  say_code(spoilt.answers[0], 11);
  EXPECT_THAT(said(spoilt, peer1).error().message, HasSubstr("has a signature that is not its own"))
      << "a receipt has no byte that nobody looks at";
  EXPECT_THAT(said(good, list(orderers, orderer)).error().message,
              HasSubstr("no orderer has signed it; revoked, so not counted: OrdererMSP CN=orderer"));

  const auto creator = said(good, user1 + user2);
  ASSERT_TRUE(creator) << creator.error().message << ": the peers validated who made it, and when";
  EXPECT_EQ(creator->peers.size(), 3U);
  for (const ReceiptProof::Certificate& one : creator->certificates)
    EXPECT_EQ(one.revoked, one.role == ReceiptProof::Certificate::Role::creator) << one.who.subject;
  const std::string all = list(organisations[0], peers[0]) + list(organisations[1], peers[1]);
  EXPECT_THAT(said(good, all).error().message, HasSubstr("1 of 3 organisations"));
}

TEST_F(ReceiptTest, ItTellsWhichListsWereLookedAtAndTakesNoneThatIsNobodys) {
  const std::string bytes = receipt_bytes(receipt(committed(0, "mine")));
  const auto none = verifier_.verify(bytes);
  ASSERT_TRUE(none) << none.error().message;
  EXPECT_TRUE(none->revocation_lists.empty());
  EXPECT_EQ(none->without_list, (std::vector<std::string>{"OrdererMSP", "Org1MSP", "Org2MSP", "Org3MSP"}));
  ReceiptTrust with = trust();
  with.revocation_lists_pem = crypto::list_of(organisations[1].ca, certificate_of(users[1]));
  with.orderers[0].revocation_lists_pem = crypto::list_of(orderers.ca, certificate_of(orderers.member("orderer")));
  const auto verifier = ReceiptVerifier::from(with);
  ASSERT_TRUE(verifier) << verifier.error().message;
  const auto proven = verifier->verify(bytes);
  ASSERT_TRUE(proven) << proven.error().message;
  ASSERT_EQ(proven->revocation_lists.size(), 2U);
  EXPECT_EQ(proven->revocation_lists[0].msp_id, "Org2MSP");
  EXPECT_EQ(proven->without_list, (std::vector<std::string>{"Org1MSP", "Org3MSP"}));
  with.revocation_lists_pem = crypto::list_of(Organisation("Org2MSP").ca, certificate_of(users[1]));
  EXPECT_THAT(ReceiptVerifier::from(with).error().message, HasSubstr("signed by none of the named authorities"));
  with.revocation_lists_pem = "no list";
  EXPECT_THAT(ReceiptVerifier::from(with).error().message, HasSubstr("revocation list"));
}

TEST_F(ReceiptTest, EveryCertificateCountsWheneverItWasValidAndItsTimeIsReported) {
  const Sent sent = committed(0, "mine");
  const TimeNs then_ns = now.real_ns;
  now.real_ns += 3'600 * ns_per_s;  // the question is asked an hour later
  const auto proven = verifier_.verify(receipt_bytes(receipt(sent)));
  ASSERT_TRUE(proven) << proven.error().message;
  std::map<ReceiptProof::Certificate::Role, int> roles;
  for (const ReceiptProof::Certificate& one : proven->certificates) {
    ++roles[one.role];
    const bool peer = one.role == ReceiptProof::Certificate::Role::peer;
    EXPECT_EQ(one.used_s, (peer ? now.real_ns : then_ns) / ns_per_s);
    EXPECT_TRUE(one.valid_when_used());
    EXPECT_GT(one.valid_to_s, one.used_s + 300 * 86'400);
    EXPECT_FALSE(one.revoked);
  }
  using enum ReceiptProof::Certificate::Role;
  EXPECT_EQ(roles,
            (std::map<ReceiptProof::Certificate::Role, int>{{orderer, 1}, {creator, 1}, {endorser, 3}, {peer, 3}}));
  ReceiptProof::Certificate one = proven->certificates[0];
  one.used_s = one.valid_to_s;
  EXPECT_TRUE(one.valid_when_used());
  ++one.used_s;
  EXPECT_FALSE(one.valid_when_used());
  one.used_s = one.valid_from_s - 1;
  EXPECT_FALSE(one.valid_when_used());
}

TEST_F(ReceiptTest, WhoMakesOneIsReportedWhichPeerIsInTheWay) {
  const Sent sent = committed(0, "mine");
  const std::string asked = question(sent.tx_id);
  const auto refusal = [&](std::vector<PeerAnswer> answers, const std::string& by = "") {
    const auto made = make_receipt("teleop", sent.tx_id, chain[sent.block], by.empty() ? asked : by, answers);
    return made ? std::string() : made.error().message;
  };
  PeerAnswer liar = answer(asked, 1), silent = answer(asked, 2);
  protos::ProposalResponse response;
  ASSERT_TRUE(response.ParseFromString(liar.response));
  Receipt::Answer lie{response.payload(), {}};
  say_code(lie, 11);
  response.set_payload(lie.payload);
  liar.response = response.SerializeAsString();
  response.clear_endorsement();
  silent.response = response.SerializeAsString();
  EXPECT_EQ(refusal({answer(asked, 0)}), "");
  EXPECT_THAT(refusal({answer(asked, 0), liar}), HasSubstr("peer1 says VALID, peer2 says MVCC_READ_CONFLICT"));
  EXPECT_THAT(refusal({answer(asked, 0), silent}), HasSubstr("peer3: its answer is not signed"));
  EXPECT_THAT(refusal({answer(question("none"), 0)}), HasSubstr("peer1: its answer is a refusal"));
  EXPECT_THAT(refusal({answer(question(sent.tx_id), 0)}), HasSubstr("peer1: its answer answers another question"));
  EXPECT_THAT(refusal({}), HasSubstr("no peer has answered"));
  const std::string other = question(sent.tx_id, "GetBlockByTxID");
  EXPECT_THAT(refusal({answer(other, 0)}, other), HasSubstr("not asked for this transaction's verdict"));
  EXPECT_THAT(make_receipt("teleop", sent.tx_id, "no block", asked, {answer(asked, 0)}).error().message,
              HasSubstr("cannot be parsed"));
}

TEST_F(ReceiptTest, WhatIsNoReceiptIsRefused) {
  const std::string good = receipt_bytes(receipt(committed(0, "mine")));
  EXPECT_THAT(why(std::string()), HasSubstr("it is no receipt"));
  EXPECT_THAT(why(std::string("ledgerline receipt 2\n")), HasSubstr("it is no receipt"));
  EXPECT_THAT(why(good + "x"), HasSubstr("something follows"));
  EXPECT_THAT(why("ledgerline receipt 1\n" + std::string(100, '\xff')), HasSubstr("cut off or damaged"));
  for (std::size_t size = 21; size < good.size(); size += 7)
    ASSERT_THAT(why(good.substr(0, size)), HasSubstr("cut off or damaged")) << size;
}

/// Any change of a receipt's bytes.
std::string changed(std::string bytes, Random& random) {
  const std::size_t at = random.next() % bytes.size();
  const std::size_t length = 1 + random.next() % std::min<std::size_t>(64, bytes.size() - at);
  switch (random.next() % 7) {
    case 0:
      bytes[at] = static_cast<char>(bytes[at] ^ (1 << random.next() % 8));
      break;
    case 1:
      bytes[at] = static_cast<char>(bytes[at] + 1 + static_cast<int>(random.next() % 255));
      break;
    case 2:
      bytes.erase(at, length);
      break;
    case 3:
      bytes.insert(at, std::string(length, static_cast<char>(random.next())));
      break;
    case 4:
      bytes.insert(at, bytes.substr(random.next() % bytes.size(), length));
      break;
    case 5:
      std::swap(bytes[at], bytes[random.next() % bytes.size()]);
      break;
    default:
      bytes.replace(at, length, bytes.substr(random.next() % bytes.size(), length));
  }
  return bytes;
}

TEST_F(ReceiptTest, RandomOnesVerifyAndChangedOnesDoNot) {
  const int receipts = slow ? 5 : seeds(50, 1'000), changes_each = 10;
  Random random(20);
  int valid = 0, invalid = 0, refused = 0, same = 0;
  for (int i = 0; i < receipts; ++i) {
    std::vector<Sent> sent;
    for (std::size_t count = 1 + random.next() % 4; count > 0; --count) {
      const std::string data(random.next() % 2'000, static_cast<char>(random.next()));
      sent.push_back(send(random.next() % 3, data, random.next() % 4 != 0));
    }
    commit();
    const Receipt made = receipt(sent[random.next() % sent.size()]);
    const std::string bytes = receipt_bytes(made);
    ASSERT_EQ(receipt_bytes(*read_receipt(bytes)), bytes);
    const auto proven = verifier_.verify(bytes);
    ASSERT_TRUE(proven) << i << ": " << proven.error().message;
    ++(proven->code == protos::VALID ? valid : invalid);
    for (int change = 0; change < changes_each; ++change) {
      const std::string bent = changed(bytes, random);
      if (bent == bytes) {
        ++same;
        --change;  // no change: another one in its place
        continue;
      }
      const auto lie = verifier_.verify(bent);
      ASSERT_FALSE(lie) << "receipt " << i << ", change " << change;
      ++refused;
    }
  }
  std::printf("%d receipts of valid transactions, %d of invalid ones; %d changed ones refused (%d were no change)\n",
              valid, invalid, refused, same);
  EXPECT_EQ(refused, receipts * changes_each);
  if (!slow) {
    EXPECT_GT(valid, receipts / 4);
    EXPECT_GT(invalid, receipts / 10);
  }
}

TEST_F(ReceiptTest, EveryByteOfAReceiptCounts) {
  const std::string good = receipt_bytes(receipt(committed(0, "mine")));
  const std::size_t step = slow ? 101 : static_cast<std::size_t>(seeds(7, 1));
  for (std::size_t at = 0; at < good.size(); at += step) {
    std::string bent = good;
    bent[at] = static_cast<char>(bent[at] ^ 1);
    ASSERT_NE(why(bent), "") << at;
  }
}

}  // namespace
}  // namespace ledgerline::fabric
