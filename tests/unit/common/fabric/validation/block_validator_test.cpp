#include "common/fabric/validation/block_validator.hpp"

#include <functional>
#include <map>

#include "common/base/random.hpp"
#include "common/configtx.pb.h"
#include "common/configuration.pb.h"
#include "common/fabric/tx/envelope.hpp"
#include "tests/unit/common/fabric/validation/signed_chain.hpp"

/// Those who would like to add to a chain that is not theirs.
namespace ledgerline::fabric {
namespace {

class BlockValidatorTest : public ::testing::Test, protected SignedChain {
 protected:
  BlockValidator make_validator() const {
    auto validator = BlockValidator::from(chain_[0].SerializeAsString(), "teleop", library);
    EXPECT_TRUE(validator) << validator.error().message;
    return std::move(validator).value();
  }
  /// A block 1 that an orderer has signed.
  common::Block good() {
    common::Block block = add("transaction", &orderer_);
    chain_.pop_back();
    return block;
  }
  static std::string why(BlockValidator validator, const common::Block& block) {
    const Status valid = validator.validate(block);
    return valid ? "" : valid.error().message;
  }
  BlockValidator::Fetch from_chain() const {
    return [this](std::uint64_t number) -> Result<common::Block> { return chain_.at(number); };
  }
};

TEST_F(BlockValidatorTest, AConfigurationSaysWhenBlocksAreCutAndByWhosePolicy) {
  const auto config = read_channel_config(chain_[0]).value();
  ASSERT_TRUE(config.batching);
  EXPECT_EQ(config.batching->timeout_ns, 10 * ns_per_ms);
  EXPECT_EQ(config.batching->max_messages, 1U);
  EXPECT_EQ(config.endorsement_words, "MAJORITY Endorsement");
  EXPECT_EQ(config.consensus, "ledgerline-node");
}

TEST_F(BlockValidatorTest, AConfigurationSaysWhereItsOrderersListen) {
  common::Envelope envelope;
  common::Payload payload;
  common::ConfigEnvelope config;
  ASSERT_TRUE(envelope.ParseFromString(chain_[0].data().data(0)) && payload.ParseFromString(envelope.payload()) &&
              config.ParseFromString(payload.data()));
  const auto addresses_with = [&](google::protobuf::Map<std::string, common::ConfigValue>* values, const char* key) {
    common::OrdererAddresses addresses;
    addresses.add_addresses("orderer:7050");
    (*values)[key].set_value(addresses.SerializeAsString());
    payload.set_data(config.SerializeAsString());
    envelope.set_payload(payload.SerializeAsString());
    common::Block block = chain_[0];
    block.mutable_data()->set_data(0, envelope.SerializeAsString());
    return read_channel_config(block).value().orderer_addresses;
  };
  const std::vector<std::string> one{"orderer:7050"};
  common::ConfigGroup& channel = *config.mutable_config()->mutable_channel_group();
  EXPECT_EQ(addresses_with(channel.mutable_values(), "OrdererAddresses"), one);
  auto& organisations = *(*channel.mutable_groups())["Orderer"].mutable_groups();
  EXPECT_EQ(addresses_with(organisations.begin()->second.mutable_values(), "Endpoints"), one)
      << "not those of all, too";
}

TEST(GoDuration, IsReadAsConfigurationsHaveIt) {
  EXPECT_EQ(read_go_duration("2s"), 2 * ns_per_s);
  EXPECT_EQ(read_go_duration("1m0.5s"), 60'500 * ns_per_ms);
  EXPECT_EQ(read_go_duration("250000us"), 250 * ns_per_ms);
  EXPECT_EQ(read_go_duration("1h2m3s4ms5us6ns"), 3'723'004'005'006);
  EXPECT_EQ(read_go_duration("500\u00b5s"), 500 * ns_per_us);
  EXPECT_EQ(read_go_duration("0"), 0);
  for (const char* wrong : {"", "2", "s", "-2s", "2 s", "2x", "1e300h", "nan s", "2s3", "inf"})
    EXPECT_EQ(read_go_duration(wrong), std::nullopt) << wrong;
}

TEST_F(BlockValidatorTest, WhatAnOrdererHasSignedPasses) {
  BlockValidator one = make_validator();
  EXPECT_TRUE(one.validate(chain_[0])) << "the anchor itself";
  for (int i = 0; i < 5; ++i) {
    const auto valid = one.validate(add("transaction", &orderer_));
    EXPECT_TRUE(valid) << valid.error().message;
  }
}

TEST_F(BlockValidatorTest, WhatNoOrdererHasSignedDoesNot) {
  EXPECT_NE(why(make_validator(), add("transaction")).find("no orderer has signed it"), std::string::npos);
  const auto peer = peers_.member("peer"), outsider = second_.member("orderer");
  for (const auto* signer : {&peer, &outsider}) {
    common::Block block = good();
    sign(block, *signer);
    EXPECT_NE(why(make_validator(), block).find("do not satisfy the channel's policy (0 of them count)"),
              std::string::npos);
  }
  Organisation impostor("OrdererMSP");  // the same name, another authority
  common::Block block = good();
  sign(block, impostor.member("orderer"));
  EXPECT_FALSE(why(make_validator(), block).empty());
}

TEST_F(BlockValidatorTest, AnotherBlockInPlaceOfTheOneThatWasSignedDoesNot) {
  const std::map<std::string, std::function<void(common::Block&)>> lies{
      {"number", [](auto& b) { b.mutable_header()->set_number(2); }},
      {"previous hash", [](auto& b) { b.mutable_header()->set_previous_hash(std::string(32, 'x')); }},
      {"data hash", [](auto& b) { b.mutable_header()->set_data_hash(std::string(32, 'x')); }},
      {"no metadata", [](auto& b) { b.clear_metadata(); }},
      {"no signature", [](auto& b) { b.mutable_metadata()->set_metadata(common::SIGNATURES, ""); }},
      {"bytes", [](auto& b) { b.mutable_metadata()->set_metadata(common::SIGNATURES, "\xff\xff"); }},
  };
  for (const auto& [name, lie] : lies) {
    common::Block block = good();
    lie(block);
    EXPECT_FALSE(why(make_validator(), block).empty()) << name;
  }
}

TEST_F(BlockValidatorTest, NoByteOfHeaderOrSignaturesMayDiffer) {
  const common::Block block = good();
  Random random(1);
  int passed = 0;
  for (int i = 0; i < 1'000; ++i) {
    common::Block bent = block;
    const bool header = i % 2 == 0;
    std::string bytes = header ? block.header().SerializeAsString() : block.metadata().metadata(common::SIGNATURES);
    const std::size_t at = random.next() % bytes.size();
    bytes[at] = static_cast<char>(bytes[at] ^ (1 + random.next() % 255));
    if (!header) {
      bent.mutable_metadata()->set_metadata(common::SIGNATURES, bytes);
    } else if (!bent.mutable_header()->ParseFromString(bytes)) {
      continue;
    }
    const bool same = header && bent.header().SerializeAsString() == block.header().SerializeAsString();
    if (why(make_validator(), bent).empty() && !same) ++passed;
  }
  EXPECT_EQ(passed, 0);
}

TEST_F(BlockValidatorTest, ManySignaturesOfOneCountOnce) {
  common::Block block = good();
  common::Metadata metadata;
  ASSERT_TRUE(metadata.ParseFromString(block.metadata().metadata(common::SIGNATURES)));
  *metadata.add_signatures() = metadata.signatures(0);
  // In front of the good one, one in the same name that is none.
  metadata.mutable_signatures(0)->set_signature("nothing");
  block.mutable_metadata()->set_metadata(common::SIGNATURES, metadata.SerializeAsString());
  EXPECT_EQ(why(make_validator(), block), "");
}

TEST_F(BlockValidatorTest, AConfigurationIsFollowedFromItsBlockOn) {
  BlockValidator one = make_validator();
  ASSERT_TRUE(one.validate(add("transaction", &orderer_)));
  EXPECT_FALSE(one.validate(add(config_of(second_), &other_, 2))) << "by those whom it names itself";
  sign(chain_.back(), orderer_, 2);
  const auto valid = one.validate(chain_.back());
  ASSERT_TRUE(valid) << valid.error().message;
  EXPECT_EQ(one.config_block_number(), 2U);
  const common::Block old = add("transaction", &orderer_, 2);
  EXPECT_FALSE(one.validate(old)) << "its orderers are not the channel's any more";
  sign(chain_.back(), other_, 2);
  EXPECT_TRUE(one.validate(chain_.back()));
  EXPECT_FALSE(one.validate(chain_[1])) << "from before it";
}

TEST_F(BlockValidatorTest, ABlockUnderALaterConfigurationNeedsThatFirst) {
  add("transaction", &orderer_);
  add(config_of(second_), &orderer_, 2);
  add("transaction", &other_, 2);
  add(config_of(first_), &other_, 4);
  add("transaction", &orderer_, 4);
  BlockValidator hasty = make_validator();
  EXPECT_NE(why(std::move(hasty), chain_[5]).find("was reconfigured in block 4"), std::string::npos);
  BlockValidator one = make_validator();
  const auto caught_up = one.catch_up(chain_[5], from_chain());
  ASSERT_TRUE(caught_up) << caught_up.error().message;
  EXPECT_EQ(one.config_block_number(), 4U);
  EXPECT_TRUE(one.validate(chain_[5]));
  EXPECT_TRUE(one.catch_up(chain_[5], from_chain())) << "it is known";
}

TEST_F(BlockValidatorTest, WhoHidesAConfigurationIsFoundOut) {
  add("transaction", &orderer_);
  add(config_of(second_), &orderer_, 2);
  add("transaction", &other_, 2);
  // An orderer that was taken out signs on as if it had not been.
  const auto fork = chain_;
  common::Block forged = node::make_block({4, fabric::header_hash(fork[3].header())}, {config_of(first_)});
  sign(forged, orderer_, 4);
  chain_.push_back(forged);
  common::Block newest = node::make_block({5, fabric::header_hash(forged.header())}, {"transaction"});
  sign(newest, orderer_, 4);
  BlockValidator one = make_validator();
  EXPECT_FALSE(one.catch_up(newest, from_chain()));
  EXPECT_FALSE(one.validate(newest));
  const auto no_answer = [](std::uint64_t) -> Result<common::Block> { return Error{"gone"}; };
  EXPECT_FALSE(make_validator().catch_up(newest, no_answer));
  const auto endless = [&](std::uint64_t) -> Result<common::Block> { return newest; };
  EXPECT_FALSE(make_validator().catch_up(newest, endless));
}

TEST_F(BlockValidatorTest, AnAnchorThatIsNoneIsRefusedWithTheReason) {
  const auto refused = [](const common::Block& block, const std::string& channel = "teleop") {
    const auto validator = BlockValidator::from(block.SerializeAsString(), channel, library);
    return validator ? std::string() : validator.error().message;
  };
  EXPECT_NE(refused(chain_[0], "another").find("is of channel teleop, not of another"), std::string::npos);
  EXPECT_NE(refused(add("transaction", &orderer_)).find("holds no configuration"), std::string::npos);
  common::Block torn = chain_[0];
  torn.mutable_data()->set_data(0, torn.data().data(0) + "x");
  EXPECT_FALSE(refused(torn).empty());
  node::CoreConfig nobody;
  nobody.organisations = {peers_.root()};
  EXPECT_NE(refused(node::make_block({}, {node::make_config_envelope(nobody, orderer_)})).find("BlockValidation"),
            std::string::npos);
  EXPECT_FALSE(BlockValidator::from("\xff\xff", "teleop", library));
  Random random(2);
  const std::string bytes = chain_[0].SerializeAsString();
  for (int i = 0; i < 1'000; ++i) {
    std::string bent = bytes;
    bent[random.next() % bent.size()] ^= static_cast<char>(1 + random.next() % 255);
    (void)BlockValidator::from(bent, "teleop", library);  // whatever it says, it says it
  }
}

}  // namespace
}  // namespace ledgerline::fabric
