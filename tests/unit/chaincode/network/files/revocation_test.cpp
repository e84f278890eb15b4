#include "chaincode/network/files/authority.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/common.pb.h"
#include "common/configtx.pb.h"
#include "msp/msp_config.pb.h"
#include "tests/unit/common/crypto/revocation_list.hpp"

namespace ledgerline::network {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

/// The configuration block of a channel with two organisations, whose versions tell all groups apart.
struct Channel {
  common::Config config;

  Channel() {
    common::ConfigGroup& root = *config.mutable_channel_group();
    root.set_version(3);
    common::ConfigGroup& applications = (*root.mutable_groups())["Application"];
    applications.set_version(5);
    for (const char* id : {"Org1MSP", "Org2MSP"}) {
      common::ConfigGroup& organisation = (*applications.mutable_groups())[id];
      organisation.set_version(7);
      (*organisation.mutable_values())["AnchorPeers"].set_value("anchors");
      common::ConfigValue& value = (*organisation.mutable_values())["MSP"];
      value.set_version(9);
      value.set_mod_policy("Admins");
      msp::FabricMSPConfig msp;
      msp.set_name(id);
      msp.add_root_certs("root");
      set(value, msp);
    }
  }
  static void set(common::ConfigValue& value, const msp::FabricMSPConfig& msp) {
    msp::MSPConfig envelope;
    envelope.set_type(0);
    envelope.set_config(msp.SerializeAsString());
    value.set_value(envelope.SerializeAsString());
  }
  std::string block(int type = common::CONFIG) const {
    common::ConfigEnvelope envelope;
    *envelope.mutable_config() = config;
    common::ChannelHeader header;
    header.set_type(type);
    header.set_channel_id("teleop");
    common::Payload payload;
    payload.mutable_header()->set_channel_header(header.SerializeAsString());
    payload.set_data(envelope.SerializeAsString());
    common::Envelope whole;
    whole.set_payload(payload.SerializeAsString());
    common::Block block;
    block.mutable_data()->add_data(whole.SerializeAsString());
    return block.SerializeAsString();
  }
};

common::ConfigUpdate update_in(const std::string& bytes) {
  common::Envelope envelope;
  common::Payload payload;
  common::ChannelHeader header;
  common::ConfigUpdateEnvelope signed_update;
  common::ConfigUpdate update;
  EXPECT_TRUE(envelope.ParseFromString(bytes) && payload.ParseFromString(envelope.payload()) &&
              header.ParseFromString(payload.header().channel_header()) &&
              signed_update.ParseFromString(payload.data()) && update.ParseFromString(signed_update.config_update()));
  EXPECT_EQ(header.type(), common::CONFIG_UPDATE);
  EXPECT_EQ(header.channel_id(), "teleop");
  return update;
}

msp::FabricMSPConfig msp_in(const common::ConfigValue& value) {
  msp::MSPConfig envelope;
  msp::FabricMSPConfig msp;
  EXPECT_TRUE(envelope.ParseFromString(value.value()) && msp.ParseFromString(envelope.config()));
  return msp;
}

/// Lists of an organisation's two authorities, which have one name and two keys, as after a renewal.
class Lists {
 public:
  std::string of_first(crypto::ListAge age = {}) const { return list(first_, age); }
  std::string of_second(crypto::ListAge age = {}) const { return list(second_, age); }

 private:
  static std::string list(const crypto::KeyAndCertificate& ca, crypto::ListAge age) {
    return crypto::list_of(ca, ca.certificate_pem, crypto::NamedKey::issuers, age);
  }
  const crypto::KeyAndCertificate first_ = *crypto::make_ca("ca.org1.ledgerline", "org1.ledgerline");
  const crypto::KeyAndCertificate second_ = *crypto::make_ca("ca.org1.ledgerline", "org1.ledgerline");
};

common::ConfigValue& msp_of(Channel& channel, const std::string& msp_id) {
  auto& applications = (*channel.config.mutable_channel_group()->mutable_groups())["Application"];
  return (*(*applications.mutable_groups())[msp_id].mutable_values())["MSP"];
}
Channel with_lists(const std::vector<std::string>& lists) {
  Channel channel;
  auto& value = msp_of(channel, "Org1MSP");
  auto msp = msp_in(value);
  for (const std::string& list : lists) msp.add_revocation_list(list);
  Channel::set(value, msp);
  return channel;
}
/// The lists that an update leaves in the configuration, or why there is none.
std::vector<std::string> updated(const Channel& channel, const std::string& list) {
  const auto bytes = revocation_update(channel.block(), "Org1MSP", list);
  if (!bytes) return {bytes.error().message};
  const auto update = update_in(*bytes);
  const auto& values = update.write_set().groups().at("Application").groups().at("Org1MSP").values();
  const auto msp = msp_in(values.at("MSP"));
  return {msp.revocation_list().begin(), msp.revocation_list().end()};
}

TEST(Revocation, TheUpdateChangesOneMspAndNothingElse) {
  const std::string the_list = Lists().of_first();
  const auto bytes = revocation_update(Channel().block(), "Org2MSP", the_list);
  ASSERT_TRUE(bytes) << bytes.error().message;
  const auto update = update_in(*bytes);
  EXPECT_EQ(update.channel_id(), "teleop");
  for (const auto* root : {&update.read_set(), &update.write_set()}) {
    EXPECT_EQ(root->version(), 3U);
    ASSERT_EQ(root->groups_size(), 1);
    const auto& applications = root->groups().at("Application");
    EXPECT_EQ(applications.version(), 5U);
    ASSERT_EQ(applications.groups_size(), 1);
    EXPECT_EQ(applications.groups().at("Org2MSP").version(), 7U);
  }
  const auto& values = update.write_set().groups().at("Application").groups().at("Org2MSP").values();
  ASSERT_EQ(values.size(), 1U);
  EXPECT_EQ(values.at("MSP").version(), 10U);
  EXPECT_EQ(values.at("MSP").mod_policy(), "Admins");
  const auto msp = msp_in(values.at("MSP"));
  EXPECT_EQ(msp.name(), "Org2MSP");
  EXPECT_THAT(msp.root_certs(), ElementsAre("root"));
  EXPECT_THAT(msp.revocation_list(), ElementsAre(the_list));
}

TEST(Revocation, ANewerListTakesTheOldOnesPlace) {
  const Lists lists;
  const std::string old = lists.of_first({.before_now_s = 60}), made = lists.of_first();
  const Channel channel = with_lists({old});
  EXPECT_TRUE(*has_revocation_list(channel.block(), "Org1MSP", old));
  EXPECT_FALSE(*has_revocation_list(channel.block(), "Org1MSP", made));
  EXPECT_FALSE(*has_revocation_list(channel.block(), "Org2MSP", old));
  EXPECT_THAT(updated(channel, made), ElementsAre(made));
}

TEST(Revocation, WhatAnotherAuthorityOfTheOrganisationHasRevokedStays) {
  const Lists lists;
  const std::string others = lists.of_second({.before_now_s = 600}), made = lists.of_first();
  EXPECT_THAT(updated(with_lists({others}), made), ElementsAre(others, made)) << "the same name, another key";
  EXPECT_THAT(updated(with_lists({lists.of_first({.before_now_s = 60}), others}), made), ElementsAre(others, made));
  EXPECT_THAT(updated(with_lists({"what cannot be read"}), made), ElementsAre("what cannot be read", made));
  EXPECT_TRUE(*has_revocation_list(with_lists({others, made}).block(), "Org1MSP", made));
}

TEST(Revocation, AListWithoutAKeyWhichFabricTakesForNobodysGivesWay) {
  const Lists lists;
  const auto ca = *crypto::make_ca("ca.org1.ledgerline", "org1.ledgerline");
  const std::string nameless = crypto::list_of(ca, ca.certificate_pem, crypto::NamedKey::none, {.before_now_s = 60});
  const std::string made = crypto::list_of(ca, ca.certificate_pem);
  EXPECT_THAT(updated(with_lists({nameless}), made), ElementsAre(made));
}

TEST(Revocation, AnOlderListIsRefused) {
  const Lists lists;
  constexpr auto refused = "older than the authority's list that is in force";
  EXPECT_THAT(updated(with_lists({lists.of_first()}), lists.of_first({.before_now_s = 60})),
              ElementsAre(HasSubstr(refused)));
  // The number counts before the issuer's clock.
  EXPECT_THAT(
      updated(with_lists({lists.of_first({.number = 300, .before_now_s = 60})}), lists.of_first({.number = 299})),
      ElementsAre(HasSubstr(refused)));
  EXPECT_THAT(
      updated(with_lists({lists.of_first({.number = 255})}), lists.of_first({.number = 256, .before_now_s = 60})),
      testing::SizeIs(1));
  EXPECT_THAT(updated(with_lists({lists.of_second()}), lists.of_first({.before_now_s = 60})), testing::SizeIs(2))
      << "another authority's is no measure";
}

TEST(Revocation, WhatIsNoConfigurationIsReported) {
  const auto why = [](const std::string& block, const std::string& msp_id) {
    const auto made = revocation_update(block, msp_id, "list");
    return made ? "it was taken" : made.error().message;
  };
  EXPECT_THAT(why("", "Org1MSP"), HasSubstr("not a block with a channel's configuration"));
  EXPECT_THAT(why("\xff\xff", "Org1MSP"), HasSubstr("not a block"));
  EXPECT_THAT(why(Channel().block(common::ENDORSER_TRANSACTION), "Org1MSP"), HasSubstr("not a block"));
  EXPECT_THAT(why(Channel().block(), "Org9MSP"), HasSubstr("Org9MSP is no organisation of channel teleop"));
}

}  // namespace
}  // namespace ledgerline::network
