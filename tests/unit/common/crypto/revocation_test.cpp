#include "tests/unit/common/crypto/revocation_list.hpp"

#include <gtest/gtest.h>

#include "msp/identities.pb.h"

/// Revocation lists of an organisation's authorities, as a channel's configuration holds them.
namespace ledgerline::crypto {
namespace {

class Revocation : public testing::Test {
 protected:
  std::string said_of(const KeyAndCertificate& user, const std::string& lists,
                      ListsFrom from = ListsFrom::configuration) {
    const auto registry = make_msp_registry(Library::libcrypto, {{"Org1MSP", ca_.certificate_pem, lists}}, from);
    msp::SerializedIdentity identity;
    identity.set_mspid("Org1MSP");
    identity.set_id_bytes(user.certificate_pem);
    const auto member = registry->member(identity.SerializeAsString(), std::nullopt);
    return member ? "accepted" : member.error().message;
  }
  static KeyAndCertificate user_of(const KeyAndCertificate& ca, const std::string& name) {
    return *issue(ca, {.common_name = name, .organization = "", .unit = "peer", .sans = {}});
  }

  const KeyAndCertificate ca_ = *make_ca("ca.org1.ledgerline", "org1.ledgerline");
  const KeyAndCertificate other_ca_ = *make_ca("ca.org1.ledgerline", "org1.ledgerline");  // same name, other key
  const KeyAndCertificate peer_ = user_of(ca_, "peer0"), next_ = user_of(ca_, "peer1");
};

TEST_F(Revocation, AListOfTheAuthorityEndsACertificateAndNoOther) {
  const std::string list = list_of(ca_, peer_.certificate_pem);
  EXPECT_EQ(said_of(peer_, ""), "accepted");
  EXPECT_NE(said_of(peer_, list).find("revoked"), std::string::npos);
  EXPECT_EQ(said_of(next_, list), "accepted");
  const std::string both = list + list_of(ca_, next_.certificate_pem);
  EXPECT_NE(said_of(peer_, both).find("revoked"), std::string::npos);
  EXPECT_NE(said_of(next_, both).find("revoked"), std::string::npos);
}

TEST_F(Revocation, AListThatTheAuthorityHasNotSignedEndsNothing) {
  EXPECT_EQ(said_of(peer_, list_of(other_ca_, peer_.certificate_pem)), "accepted");
  EXPECT_EQ(said_of(peer_, "no list"), "accepted");
}

TEST_F(Revocation, AListThatNamesNoKeyEndsTheWholeMspAsInFabric) {
  constexpr auto nameless = "could not obtain Authority Key Identifier for crl";
  for (const NamedKey named : {NamedKey::none, NamedKey::unreadable}) {
    const std::string list = list_of(ca_, peer_.certificate_pem, named);
    EXPECT_NE(said_of(next_, list).find(nameless), std::string::npos);
    EXPECT_NE(said_of(peer_, list).find(nameless), std::string::npos);
    EXPECT_NE(said_of(next_, list_of(ca_, peer_.certificate_pem) + list).find(nameless), std::string::npos);
    // whichever authority signed it
    EXPECT_NE(said_of(next_, list_of(other_ca_, peer_.certificate_pem, named)).find(nameless), std::string::npos);
    EXPECT_FALSE(lists_name_key(list));
  }
  EXPECT_TRUE(lists_name_key(list_of(ca_, peer_.certificate_pem)));
}

TEST_F(Revocation, AListThatNamesItsAuthorityOtherwiseThanByKeyEndsNobodyAsInFabric) {
  EXPECT_EQ(said_of(peer_, list_of(ca_, peer_.certificate_pem, NamedKey::by_name_alone)), "accepted");
}

TEST_F(Revocation, AListThatSomebodyHandedOverNeedsToNameNoKey) {
  const std::string list = list_of(ca_, peer_.certificate_pem, NamedKey::none);
  EXPECT_NE(said_of(peer_, list, ListsFrom::hand).find("revoked"), std::string::npos);
  EXPECT_EQ(said_of(next_, list, ListsFrom::hand), "accepted");
  const std::string other = list_of(other_ca_, peer_.certificate_pem, NamedKey::none);
  EXPECT_EQ(said_of(peer_, other, ListsFrom::hand), "accepted");
}

TEST_F(Revocation, AListNamesACertificateOrDoesNot) {
  const std::string list = list_of(ca_, peer_.certificate_pem);
  EXPECT_TRUE(*is_listed(list, peer_.certificate_pem));
  EXPECT_FALSE(*is_listed(list, next_.certificate_pem));
  EXPECT_TRUE(*is_listed(list + list_of(ca_, next_.certificate_pem), next_.certificate_pem));
  EXPECT_FALSE(*is_listed(list, user_of(*make_ca("ca.org2.ledgerline", "org2.ledgerline"), "peer0").certificate_pem));
  EXPECT_FALSE(*is_listed("no list", peer_.certificate_pem));
  EXPECT_FALSE(is_listed(list, "no certificate"));
}

// As `openssl x509 -noout -serial -ext authorityKeyIdentifier` has them.
TEST_F(Revocation, ACertificateSaysItsNumberAndItsAuthoritysKey) {
  const auto number = certificate_number(R"(-----BEGIN CERTIFICATE-----
MIIBPDCB4qADAgECAgwKvN4BI0VniavN7wAwCgYIKoZIzj0EAwIwDTELMAkGA1UE
AwwCY2EwIBcNMjYxMTI3MTQ1NjIzWhgPMjEyNjExMDMxNDU2MjNaMBAxDjAMBgNV
BAMMBXJhdmVuMFkwEwYHKoZIzj0CAQYIKoZIzj0DAQcDQgAECxVWwfR22c4LoECO
A2b8fZH7moCI53JLunU3Ob/a+NpUTJyOREhTJ0NtzMdNCcRQq4OO9gJEJJqWU9Ts
0q4YwqMjMCEwHwYDVR0jBBgwFoAUbkj0pai8q0JYhBf1ApRSiM9siIQwCgYIKoZI
zj0EAwIDSQAwRgIhAIqXzWXI4uXGf6k9Zfqa/4AFk3zfTWTXBra0nrDDJlA1AiEA
7FSc1MtxqEpXAeoOjnUxGU3rIp2xdMVYo4ZKjymbONk=
-----END CERTIFICATE-----
)");
  ASSERT_TRUE(number) << number.error().message;
  EXPECT_EQ(number->serial, "0abcde0123456789abcdef00");
  EXPECT_EQ(number->authority_key, "6e48f4a5a8bcab42588417f502945288cf6c8884");
  EXPECT_NE(certificate_number(peer_.certificate_pem)->serial, certificate_number(next_.certificate_pem)->serial);
  EXPECT_FALSE(certificate_number(ca_.certificate_pem)) << "it names no key of another authority's";
  EXPECT_FALSE(certificate_number("no certificate"));
}

TEST_F(Revocation, AnEntryOfAConfigurationIsReadAsFabricReadsIt) {
  const std::string list = list_of(ca_, peer_.certificate_pem), other = list_of(ca_, next_.certificate_pem);
  EXPECT_EQ(list_of_entry(list).value(), list);
  EXPECT_EQ(list_of_entry(list + other).value(), list) << "the first alone";
  const BioPtr text = bio_of(list), der(BIO_new(BIO_s_mem()));
  const CrlPtr read{PEM_read_bio_X509_CRL(text.get(), nullptr, no_pass_phrase, nullptr)};
  i2d_X509_CRL_bio(der.get(), read.get());
  EXPECT_EQ(list_of_entry(text_of(der.get())).value(), list);
  for (const std::string& none :
       {std::string(), std::string("no list"), "\n" + list, ca_.certificate_pem, list.substr(0, list.size() / 2)}) {
    const auto refused = list_of_entry(none);
    ASSERT_FALSE(refused) << none;
    EXPECT_NE(refused.error().message.find("cannot be read"), std::string::npos);
  }
}

TEST_F(Revocation, WhoHandsListsOverIsReportedWhoseTheyAreAndWhichIsNone) {
  const std::vector<MspRoot> roots{{"Org2MSP", other_ca_.certificate_pem}, {"Org1MSP", ca_.certificate_pem}};
  const auto why = [&](const std::string& text) { return read_revocation_lists(text, roots).error().message; };
  const std::string list = list_of(ca_, peer_.certificate_pem), other = list_of(other_ca_, peer_.certificate_pem);
  const auto both = read_revocation_lists(list + other, roots);
  ASSERT_TRUE(both) << both.error().message;
  ASSERT_EQ(both->size(), 2U);
  EXPECT_EQ((*both)[0].msp_id, "Org1MSP");
  EXPECT_EQ((*both)[1].msp_id, "Org2MSP");
  EXPECT_NEAR(static_cast<double>((*both)[0].made_s), static_cast<double>(std::time(nullptr)), 60);
  const KeyAndCertificate third = *make_ca("ca.org1.ledgerline", "org1.ledgerline");
  EXPECT_EQ(why(list + list_of(third, peer_.certificate_pem)),
            "a revocation list is signed by none of the named authorities");
  EXPECT_NE(why("no list").find("there is no revocation list in it"), std::string::npos);
  EXPECT_NE(why(ca_.certificate_pem).find("there is no revocation list in it"), std::string::npos);
  std::string damaged = list;
  damaged[damaged.size() / 2] = '!';
  EXPECT_NE(why(list + damaged).find("cannot be read"), std::string::npos);
  EXPECT_NE(why(list + list.substr(0, list.size() / 2)).find("cannot be read"), std::string::npos);
}

}  // namespace
}  // namespace ledgerline::crypto
