#include "chaincode/network/setup/deployment.hpp"

#include "chaincode/network/setup/site.hpp"
#include "tests/unit/chaincode/network/setup/fake_tools.hpp"

namespace ledgerline::network {
namespace {

using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;
using testing::StartsWith;

class DeploymentTest : public testing::Test {
 protected:
  /// A network on this host, or this host's part of one on several.
  void start(Options options) {
    // The identities of a network on several hosts come from elsewhere.
    Options all = options;
    all.only.clear();
    Site whole(all);
    ASSERT_TRUE(whole.open().ok());
    ASSERT_TRUE(make_crypto_material(whole).ok());
    site = std::make_unique<Site>(options);
    ASSERT_TRUE(site->open().ok());
    deployment = std::make_unique<Deployment>(*site);
    ASSERT_TRUE(deployment->make_packages().ok());
  }
  /// The channel has this definition, and the directory the mark of the version before, which is empty.
  void before(const std::string& definition, const std::string& first = "") {
    tools.script("peer",
                 first + "echo \"${0##*/} $*\" >>" + tools.options().dir + "/../calls; echo '" + definition + "'");
    ASSERT_TRUE(write_file(site->in("done/contract-teleop"), "", 0644).ok());
  }
  FakeTools tools;
  std::unique_ptr<Site> site;
  std::unique_ptr<Deployment> deployment;
};

TEST_F(DeploymentTest, EveryPeerGetsItsPackageOnce) {
  start(tools.options());
  ASSERT_TRUE(deployment->install().ok());
  EXPECT_THAT(tools.calls(), ElementsAre("peer lifecycle chaincode install " + site->in("package1/ledgerline.tgz"),
                                         "peer lifecycle chaincode install " + site->in("package2/ledgerline.tgz"),
                                         "peer lifecycle chaincode install " + site->in("package3/ledgerline.tgz")));
  ASSERT_TRUE(deployment->install().ok());
  EXPECT_THAT(tools.calls(), IsEmpty());
}

TEST_F(DeploymentTest, APackageStaysTheSameOverStarts) {
  start(tools.options());
  const auto package = read_file(site->in("package1/ledgerline.tgz"));
  ASSERT_TRUE(package.ok());
  ASSERT_TRUE(Deployment(*site).make_packages().ok());
  EXPECT_EQ(*read_file(site->in("package1/ledgerline.tgz")), *package) << "its hash is in what was approved";
}

TEST_F(DeploymentTest, AllOrganisationsApproveThenOneCommits) {
  start(tools.options());
  ASSERT_TRUE(deployment->define().ok());
  const auto calls = tools.calls();
  EXPECT_THAT(calls, ElementsAre(StartsWith("peer lifecycle chaincode approveformyorg --package-id ledgerline_1:"),
                                 StartsWith("peer lifecycle chaincode approveformyorg --package-id ledgerline_1:"),
                                 StartsWith("peer lifecycle chaincode approveformyorg --package-id ledgerline_1:"),
                                 StartsWith("peer lifecycle chaincode commit -o " + site->addresses().orderer(1))));
  EXPECT_THAT(calls, Each(HasSubstr("--channelID teleop --name ledgerline --version 4 --sequence 1")));
  ASSERT_TRUE(deployment->define().ok());
  EXPECT_THAT(tools.calls(), IsEmpty());
}

TEST_F(DeploymentTest, ANetworkWithTheContractOfBeforeGetsTheNextDefinition) {
  start(tools.options());
  before(R"({"sequence":4,"version":"1"})");
  ASSERT_TRUE(deployment->define().ok());
  const auto calls = tools.calls();
  ASSERT_THAT(calls, SizeIs(5));
  EXPECT_THAT(calls.front(), HasSubstr(" querycommitted --channelID teleop "));
  for (std::size_t i = 1; i < calls.size(); ++i) {
    EXPECT_THAT(calls[i], HasSubstr(i < 4 ? " approveformyorg " : " commit "));
    EXPECT_THAT(calls[i], HasSubstr("--version 4 --sequence 5"));
    EXPECT_THAT(calls[i], testing::Not(HasSubstr("--signature-policy"))) << "a majority, whatever it was before";
  }
  ASSERT_TRUE(deployment->define().ok());
  EXPECT_THAT(tools.calls(), IsEmpty());
}

TEST_F(DeploymentTest, WhatAnotherHostHasCommittedIsApprovedAsItIs) {
  start(tools.options());
  before(R"({"sequence":5,"version":"4"})");
  ASSERT_TRUE(deployment->define().ok());
  EXPECT_THAT(tools.calls(), ElementsAre(HasSubstr(" querycommitted "), HasSubstr("--version 4 --sequence 5"),
                                         HasSubstr("--version 4 --sequence 5"), HasSubstr("--version 4 --sequence 5")));
  EXPECT_TRUE(deployment->wait_for_definition().ok());
}

TEST_F(DeploymentTest, APeerThatIsJustStartingIsAskedAgain) {
  start(tools.options());
  before(R"({"sequence":2,"version":"4"})", "[ -e \"$0.asked\" ] || { touch \"$0.asked\"; exit 1; }; ");
  ASSERT_TRUE(deployment->define().ok());
  EXPECT_THAT(tools.calls(), SizeIs(4));
}

TEST_F(DeploymentTest, APeerThatSaysNoDefinitionIsAnError) {
  start(tools.options());
  before("a moment, please");
  const Status defined = deployment->define();
  ASSERT_FALSE(defined);
  EXPECT_THAT(defined.error().message, HasSubstr("a moment, please"));
}

TEST_F(DeploymentTest, AHostWithoutTheFirstOrganisationApprovesItsOwnAndCommitsNothing) {
  Options options = tools.options();
  for (int k = 1; k <= 3; ++k) {
    const std::string host = "10.0.0." + std::to_string(k);
    options.organisation_addresses.push_back({host, 7051});
    if (k == 1) options.orderer_addresses.push_back({host, 7061});
  }
  options.only = {"org2"};
  start(options);
  ASSERT_TRUE(deployment->define().ok());
  EXPECT_THAT(tools.calls(), ElementsAre(HasSubstr(" approveformyorg ")));
  ASSERT_TRUE(deployment->wait_for_contract().ok());
  EXPECT_THAT(tools.calls(), SizeIs(1));
}

TEST_F(DeploymentTest, AServiceThatEndsAtItsStartIsNamed) {
  Options options = tools.options();
  tools.script("chaincode", "echo 'no key' >&2; exit 1");
  options.chaincode = options.tools + "/chaincode";
  start(options);
  const Status started = deployment->start_services();
  ASSERT_FALSE(started);
  EXPECT_THAT(started.error().message, HasSubstr("chaincode"));
  EXPECT_THAT(started.error().message, HasSubstr("no key"));
}

}  // namespace
}  // namespace ledgerline::network
