#include "common/fabric/validation/transaction_validator.hpp"

#include <gtest/gtest.h>

#include <set>

#include "common/policies.pb.h"
#include "peer/transaction.pb.h"
#include "tests/unit/common/crypto/revocation_list.hpp"
#include "tests/unit/common/fabric/validation/validated_channel.hpp"

/// What Fabric's peers say of these transactions tests/system/validation finds out; here it is written down.
namespace ledgerline::fabric {
namespace {

using Codes = std::set<int>;
const Codes valid{protos::VALID}, policy{protos::ENDORSEMENT_POLICY_FAILURE},
    form{protos::INVALID_ENDORSER_TRANSACTION};
const Codes headers{protos::BAD_COMMON_HEADER}, contract{protos::INVALID_CHAINCODE},
    other{protos::INVALID_OTHER_REASON};

/// Those that are not named are valid.
const std::map<std::string, Codes> expected{
    {"an epoch", headers},
    {"another type", headers},
    {"a type that nobody knows", headers},
    {"no nonce", headers},
    {"an id of another", {protos::BAD_PROPOSAL_TXID}},
    {"no id", {protos::BAD_PROPOSAL_TXID}},
    {"a nonce behind the id", {protos::BAD_PROPOSAL_TXID}},
    {"a header extension that is none", {protos::BAD_HEADER_EXTENSION}},
    {"a header without contract", other},
    {"a header with an empty contract", contract},
    {"a header of another contract", contract},
    {"a contract that is not there", contract},
    {"data that is no transaction", form},
    {"no action", form},
    {"two actions", form},
    {"an action without header", form},
    {"an action that is none", form},
    {"another proposal's hash", form},
    {"a response that is none", form},
    {"a response without result", {protos::BAD_RESPONSE_PAYLOAD}},
    {"a result that is none", {protos::BAD_RESPONSE_PAYLOAD}},
    {"reads and writes that are none", {protos::BAD_RWSET}},
    {"a namespace's that are none", {protos::BAD_RWSET}},
    {"a result without contract", other},
    {"a result of another contract", contract},
    {"a result of no version", contract},
    {"an event that is none", other},
    {"an event of another contract", other},
    {"a namespace twice", {protos::ILLEGAL_WRITESET}},
    {"a write to _lifecycle", policy},
    {"a write to a contract that is not there", contract},
    {"no endorsement", policy},
    {"one organisation alone", policy},
    {"one organisation's two peers", policy},
    {"a client beside a peer", policy},
    {"an administrator beside a peer", policy},
    {"a peer of an authority that is nobody's", policy},
    {"one peer twice", policy},
    {"one peer's certificate laid out twice", policy},
    {"a signature of something else", policy},
    {"a high S", policy},
    {"a result that was changed behind the endorsement", policy},
    {"a kept key by another", policy},
    {"a kept key by two others", policy},
    {"a kept key deleted by another", policy},
    {"its policy replaced by another", policy},
    {"a kept key beside a free one, by its owner", policy},
    {"a range without its last keys", {protos::PHANTOM_READ_CONFLICT}},
    {"a version that is not the newest", {protos::MVCC_READ_CONFLICT}},
    {"a version that never was", {protos::MVCC_READ_CONFLICT}},
    {"read as absent", {protos::MVCC_READ_CONFLICT}},
};

class TransactionValidation : public ::testing::Test, protected ValidatedChannel {};

TEST_F(TransactionValidation, SaysOfEachKindWhatAPeerSays) {
  std::set<std::string> named;
  for (const Kind& one : all_) {
    if (one.again) continue;
    const std::vector<TransactionVerdict> verdicts = validate({sealed(one.name)});
    const auto found = expected.find(one.name);
    EXPECT_TRUE((found == expected.end() ? valid : found->second).contains(verdicts[0].code))
        << one.name << ": " << verdicts[0].code << ' ' << verdicts[0].why;
    EXPECT_EQ(verdicts[0].code == protos::VALID, *verdicts[0].why == '\0') << one.name;
    named.insert(one.name);
  }
  for (const auto& [name, codes] : expected) EXPECT_TRUE(named.contains(name)) << name;
}

TEST_F(TransactionValidation, AnIdIsGoodForOneTransaction) {
  const std::string once = sealed("blind write by two peers");
  EXPECT_EQ(commit({once, once}), (std::vector<int>{protos::VALID, protos::DUPLICATE_TXID}));
  EXPECT_EQ(commit({once}), std::vector<int>{protos::DUPLICATE_TXID});
}

TEST_F(TransactionValidation, WhatWasReadMustNotHaveChangedWithinTheBlockEither) {
  Draft reads = draft();
  kvrwset::KVRead& read = *reads.set.add_reads();
  read.set_key("draft/free/7");
  read.mutable_version()->set_block_num(1);
  Draft writes = draft();
  write(writes, "draft/free/7");
  const std::string one = reads.seal(), other_one = writes.seal();
  EXPECT_EQ(validate({one})[0].code, protos::VALID);
  EXPECT_EQ(validate({other_one, one})[1].code, protos::MVCC_READ_CONFLICT);
  EXPECT_EQ(validate({sealed("a key of the range written"), sealed("a whole range read")})[1].code,
            protos::PHANTOM_READ_CONFLICT);
}

TEST_F(TransactionValidation, AKeyWhosePolicyTheBlockHasSetIsWrittenByNobodyBehindIt) {
  random_ = Random(5);
  const std::string sets = sealed("its policy replaced by its owner");
  random_ = Random(5);  // the same key
  const std::string writes = sealed("a kept key by its owner");
  EXPECT_EQ(validate({sets, writes})[1].code, protos::ENDORSEMENT_POLICY_FAILURE);
  EXPECT_EQ(validate({writes})[0].code, protos::VALID);
}

TEST_F(TransactionValidation, OfOneIdentityOneEndorsementCounts) {
  common::SignaturePolicyEnvelope twice;  // two of Org1MSP's peers
  ASSERT_TRUE(twice.ParseFromString(peer_policy("Org1MSP")));
  twice.mutable_rule()->mutable_n_out_of()->set_n(2);
  twice.mutable_rule()->mutable_n_out_of()->add_rules()->set_signed_by(0);
  Draft made = draft();
  write(made, "draft/two");
  kvrwset::KVMetadataWrite& metadata = *made.set.add_metadata_writes();
  metadata.set_key("draft/two");
  metadata.add_entries()->set_name(validation_parameter);
  metadata.mutable_entries(0)->set_value(twice.SerializeAsString());
  ASSERT_EQ(commit({made.seal()}), std::vector<int>{protos::VALID});
  const auto code_with = [&](const crypto::SigningIdentity& second) {
    Draft written = draft();
    write(written, "draft/two");
    written.endorsers = {&cast_.peers[0], &second};
    return validate({written.seal()})[0].code;
  };
  EXPECT_EQ(code_with(cast_.new_peers[0]), protos::VALID);
  EXPECT_EQ(code_with(cast_.peers[0]), protos::ENDORSEMENT_POLICY_FAILURE);
  crypto::SigningIdentity laid_out = cast_.peers[0];  // the same certificate, another PEM
  msp::SerializedIdentity identity;
  ASSERT_TRUE(identity.ParseFromString(laid_out.serialized));
  identity.set_id_bytes(identity.id_bytes() + "\n");
  laid_out.serialized = identity.SerializeAsString();
  EXPECT_EQ(code_with(laid_out), protos::ENDORSEMENT_POLICY_FAILURE);
}

TEST_F(TransactionValidation, OnceEndorsementsAreEnoughNoFurtherOneIsVerified) {
  fill();
  Draft three = draft();
  three.endorsers = {&cast_.peers[0], &cast_.peers[1], &cast_.peers[2]};
  write(three, "draft/free/1");  // a majority's
  Draft own = draft();
  own.endorsers = three.endorsers;
  write(own, "draft/own/1");  // Org1MSP's
  Draft late = draft();
  late.endorsers = {&cast_.peers[1], &cast_.peers[2], &cast_.peers[0]};
  write(late, "draft/own/2");
  Draft worthless = draft();
  worthless.endorsers = three.endorsers;
  worthless.on_endorsements = [](std::vector<protos::Endorsement>& all) { all[0].mutable_signature()->back() ^= 1; };
  write(worthless, "draft/free/2");
  const auto verdicts = validate({three.seal(), own.seal(), late.seal(), worthless.seal()});
  for (const TransactionVerdict& one : verdicts) EXPECT_EQ(one.code, protos::VALID) << one.why;
  EXPECT_EQ(verdicts[0].endorsements_verified, (std::vector<bool>{true, true}));
  EXPECT_EQ(verdicts[1].endorsements_verified, (std::vector<bool>{true}));
  EXPECT_EQ(verdicts[2].endorsements_verified, (std::vector<bool>{true, true, true}));
  EXPECT_EQ(verdicts[3].endorsements_verified, (std::vector<bool>{false, true, true}));
}

TEST_F(TransactionValidation, AKeyWrittenTwiceAtOnceIsTakenAsFabricTakesIt) {
  Draft made = draft();
  for (const char* key : {"draft/free/1", "draft/free/1", "draft/new", "draft/new"}) write(made, key);
  ASSERT_EQ(commit({made.seal()}), std::vector<int>{protos::VALID});
  EXPECT_FALSE(state_.find({"ledgerline", "", "draft/new"})) << "as metadata of a key that is not there";
  EXPECT_EQ(state_.find({"ledgerline", "", "draft/free/1"})->version, (Version{height_, 0}));
}

TEST_F(TransactionValidation, AKeyAndItsPolicyAreTakenTogether) {
  const KeyName own{"ledgerline", "", "draft/own/3"};
  ASSERT_EQ(state_.find(own)->policy, peer_policy("Org1MSP"));
  Draft writes = draft();
  write(writes, own.key);
  writes.endorsers = {&cast_.peers[0]};
  ASSERT_EQ(commit({writes.seal()}), std::vector<int>{protos::VALID});
  EXPECT_EQ(state_.find(own)->policy, peer_policy("Org1MSP")) << "a new value keeps it";
  Draft deletes = draft();
  deletes.set.add_writes()->set_key(own.key);  // without a value
  deletes.endorsers = {&cast_.peers[0]};
  ASSERT_EQ(commit({deletes.seal()}), std::vector<int>{protos::VALID});
  EXPECT_FALSE(state_.find(own));
  Draft again = draft();
  write(again, own.key);
  ASSERT_EQ(commit({again.seal()}), std::vector<int>{protos::VALID});
  EXPECT_EQ(state_.find(own)->policy, "") << "a deletion ends it";
}

TEST_F(TransactionValidation, ACreatorWhoDidNotSignIsNone) {
  Draft made = draft();
  const crypto::SigningIdentity& outsider = cast_.nobodys;
  made.creator = &outsider;
  EXPECT_EQ(validate({made.seal()})[0].code, protos::BAD_CREATOR_SIGNATURE);
  common::Envelope envelope;
  ASSERT_TRUE(envelope.ParseFromString(sealed("blind write by two peers")));
  envelope.set_signature("nothing");
  EXPECT_EQ(validate({envelope.SerializeAsString()})[0].code, protos::BAD_CREATOR_SIGNATURE);
}

TEST_F(TransactionValidation, AnOrganisationWhoseRevocationListNamesNoKeyIsNobodyAsInFabric) {
  const auto code_with_list_of = [&](const Organisation& organisation, crypto::NamedKey named) {
    auto roots = config_.organisations;
    for (crypto::MspRoot& root : roots) {
      if (root.msp_id == organisation.msp_id)
        root.revocation_lists_pem = crypto::list_of(organisation.ca, organisation.ca.certificate_pem, named);
    }
    members_ = crypto::make_msp_registry(library, roots);
    return validate({sealed("blind write by two peers")})[0].code;
  };
  EXPECT_EQ(code_with_list_of(first_, crypto::NamedKey::issuers), protos::VALID);
  EXPECT_EQ(code_with_list_of(first_, crypto::NamedKey::none), protos::BAD_CREATOR_SIGNATURE);
  EXPECT_EQ(code_with_list_of(second_, crypto::NamedKey::none), protos::ENDORSEMENT_POLICY_FAILURE);
  EXPECT_EQ(code_with_list_of(third_, crypto::NamedKey::none), protos::VALID) << "it has no part in it";
}

TEST_F(TransactionValidation, AnEventOfAnotherTransactionIsRefusedWhereTheRulesSaySo) {
  const std::string event = sealed("an event");
  EXPECT_EQ(validate({event})[0].code, protos::VALID);
  EXPECT_EQ(validate({event}, {"teleop", false})[0].code, protos::INVALID_OTHER_REASON);
}

TEST_F(TransactionValidation, AnotherChannelsTransactionIsNone) {
  EXPECT_EQ(validate({sealed("blind write by two peers")}, {"other", true})[0].code, protos::TARGET_CHAIN_NOT_FOUND);
}

}  // namespace
}  // namespace ledgerline::fabric
