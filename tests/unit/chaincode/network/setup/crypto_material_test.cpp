#include "chaincode/network/setup/site.hpp"

#include "chaincode/identities/identities.hpp"
#include "tests/unit/chaincode/network/setup/fake_tools.hpp"

namespace ledgerline::network {
namespace {

using testing::HasSubstr;

TEST(CryptoMaterialTest, IsMadeOnceWithThePeersBuilderScripts) {
  const FakeTools tools;
  Site site(tools.options());
  ASSERT_TRUE(site.open().ok());
  ASSERT_TRUE(make_crypto_material(site).ok());
  const auto ca = identities::peer_dir(site.options().dir, 3) / "tls" / "ca.crt";
  const auto made = read_file(ca);
  ASSERT_TRUE(made.ok());
  EXPECT_EQ(::access(site.in("builder/bin/detect").c_str(), X_OK), 0);
  ASSERT_TRUE(make_crypto_material(site).ok());
  EXPECT_EQ(*read_file(ca), *made);
}

TEST(CryptoMaterialTest, AHostOfSeveralMakesNoneOfItsOwn) {
  const FakeTools tools;
  Options options = tools.options();
  for (int k = 1; k <= 3; ++k) {
    const std::string host = "10.0.0." + std::to_string(k);
    options.organisation_addresses.push_back({host, 7051});
    if (k == 1) options.orderer_addresses.push_back({host, 7061});
  }
  options.only = {"org1"};
  Site site(options);
  ASSERT_TRUE(site.open().ok());
  const Status made = make_crypto_material(site);
  ASSERT_FALSE(made);
  EXPECT_THAT(made.error().message, HasSubstr("crypto is missing: the hosts of a network share its identities"));
}

}  // namespace
}  // namespace ledgerline::network
