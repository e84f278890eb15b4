#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>

#include "common/crypto/crypto.hpp"
#include "msp/identities.pb.h"

namespace ledgerline::crypto {
namespace {

namespace fs = std::filesystem;

std::string serialized(const std::string& msp_id, const std::string& pem) {
  msp::SerializedIdentity identity;
  identity.set_mspid(msp_id);
  identity.set_id_bytes(pem);
  return identity.SerializeAsString();
}

KeyAndCertificate user_of(const KeyAndCertificate& ca, const std::string& name, const std::string& unit,
                          int days = 3650) {
  return issue(ca, {.common_name = name, .organization = "", .unit = unit, .sans = {}, .days = days}).value();
}

class Msp : public testing::Test {
 protected:
  KeyAndCertificate ca_ = make_ca("ca.org1.ledgerline", "org1.ledgerline").value();
  KeyAndCertificate other_ca_ = make_ca("ca.org1.ledgerline", "org1.ledgerline").value();  // same name, other key
  std::unique_ptr<MspRegistry> registry_ = make_msp_registry(Library::libcrypto, {{"Org1MSP", ca_.certificate_pem}});
  std::int64_t now_ = std::time(nullptr);

  std::string refusal(const std::string& bytes) {
    auto member = registry_->member(bytes, now_);
    return member ? "accepted" : member.error().message;
  }
};

TEST_F(Msp, MembersAreNamedByMspAndSubject) {
  const auto user = user_of(ca_, "User1@org1.ledgerline", "client");
  const auto member = registry_->member(serialized("Org1MSP", user.certificate_pem), now_).value();
  EXPECT_EQ(member->name.msp_id, "Org1MSP");
  EXPECT_EQ(member->name.subject, "CN=User1@org1.ledgerline,OU=client");
  EXPECT_FALSE(member->admin);
  EXPECT_FALSE(member->peer);
  const auto signer = make_signer(Library::mbedtls, user.key_pem).value();
  EXPECT_TRUE(member->verifier->verify("x", signer->sign("x").value()));
}

TEST_F(Msp, UnitsSayWhoIsAdminAndWhoIsPeer) {
  EXPECT_TRUE(registry_->member(serialized("Org1MSP", user_of(ca_, "Admin@org1", "admin").certificate_pem), now_)
                  .value()
                  ->admin);
  EXPECT_TRUE(
      registry_->member(serialized("Org1MSP", user_of(ca_, "peer0.org1", "peer").certificate_pem), now_).value()->peer);
}

TEST_F(Msp, AMemberHasExactlyOneRole) {
  const auto of = [&](const std::string& unit) {
    return refusal(serialized("Org1MSP", user_of(ca_, "User1@org1", unit).certificate_pem));
  };
  EXPECT_EQ(of("client"), "accepted");
  EXPECT_NE(of("drones").find("does not have an OU that resolves to client, peer, orderer, or admin"),
            std::string::npos);
}

TEST_F(Msp, ACertificateIsOverWithItsLastSecondAsInFabric) {
  const auto user = user_of(ca_, "User1@org1", "client", 1);
  const std::string bytes = serialized("Org1MSP", user.certificate_pem);
  const std::int64_t end_s = parse_certificate(user.certificate_pem).value().not_after_s;
  EXPECT_TRUE(registry_->member(bytes, end_s - 1));
  EXPECT_FALSE(registry_->member(bytes, end_s));
  EXPECT_TRUE(registry_->member(bytes, std::nullopt)) << "a block's transactions count whenever that was";
}

TEST_F(Msp, RenewalKeepsTheName) {
  const auto first =
      registry_->member(serialized("Org1MSP", user_of(ca_, "User1@org1", "client").certificate_pem), now_).value();
  const auto second =
      registry_->member(serialized("Org1MSP", user_of(ca_, "User1@org1", "client").certificate_pem), now_).value();
  EXPECT_NE(first->pem, second->pem);
  EXPECT_EQ(first->name, second->name);
}

TEST_F(Msp, OutsidersAreRefusedWithTheReason) {
  const auto user = user_of(ca_, "User1@org1", "client");
  EXPECT_EQ(refusal(serialized("Org9MSP", user.certificate_pem)), "MSP Org9MSP is unknown");
  EXPECT_NE(refusal(serialized("Org1MSP", user_of(other_ca_, "User1@org1", "client").certificate_pem))
                .find("signed by unknown authority"),
            std::string::npos);
  EXPECT_NE(refusal(serialized("Org1MSP", ca_.certificate_pem)).find("cannot be used as an identity"),
            std::string::npos);
  EXPECT_NE(refusal(serialized("Org1MSP", "no certificate")).find("PEM"), std::string::npos);
  EXPECT_NE(refusal("\xff\xff\xff").find("could not deserialize"), std::string::npos);
  EXPECT_NE(refusal(std::string(1 << 20, 'x')).find("could not deserialize"), std::string::npos);
}

TEST_F(Msp, AnEncryptedCertificateIsRefusedWithoutAskingForItsPassPhrase) {
  std::string pem = user_of(ca_, "User1@org1", "client").certificate_pem;
  pem.insert(pem.find('\n') + 1, "Proc-Type: 4,ENCRYPTED\nDEK-Info: AES-128-CBC,000102030405060708090a0b0c0d0e0f\n\n");
  EXPECT_NE(refusal(serialized("Org1MSP", pem)).find("could not decode the PEM structure"), std::string::npos);
  EXPECT_FALSE(parse_certificate(pem));
  EXPECT_FALSE(make_signer(Library::libcrypto, pem));
}

TEST_F(Msp, BytesBehindACertificateAreRefused) {
  std::string pem = user_of(ca_, "User1@org1", "client").certificate_pem;
  std::replace(pem.begin(), pem.end(), '=', 'A');  // the padding of base64
  pem.insert(pem.find("\n-----END"), "AAAA");
  EXPECT_NE(refusal(serialized("Org1MSP", pem)).find("trailing data"), std::string::npos);
}

TEST_F(Msp, TheNameOfAnUnknownOrganisationIsShownAsAPersonCanReadIt) {
  const std::string why = refusal(serialized("a\nb\x1b[2J" + std::string(10'000, 'x'), ""));
  EXPECT_EQ(why.find("MSP a?b?[2Jxxx"), 0U) << why;
  EXPECT_LT(why.size(), 300U);
}

TEST_F(Msp, ValidityIsCheckedOnEveryUse) {
  const auto bytes = serialized("Org1MSP", user_of(ca_, "User1@org1", "client", 1).certificate_pem);
  EXPECT_TRUE(registry_->member(bytes, now_));
  EXPECT_FALSE(registry_->member(bytes, now_ + 2 * 86400));  // out of the cache
  EXPECT_FALSE(registry_->member(bytes, now_ - 86400));
  EXPECT_TRUE(registry_->member(bytes, now_));
}

TEST_F(Msp, ACertificateDoesNotOutliveItsCa) {
  const auto bytes = serialized("Org1MSP", user_of(ca_, "User1@org1", "client", 20 * 365).certificate_pem);
  EXPECT_TRUE(registry_->member(bytes, now_));
  EXPECT_FALSE(registry_->member(bytes, now_ + 11LL * 365 * 86400));
}

TEST_F(Msp, TheCacheGivesTheSameMemberAndStaysCorrectWhenItOverflows) {
  const auto user = serialized("Org1MSP", user_of(ca_, "User1@org1", "client").certificate_pem);
  const auto member = registry_->member(user, now_).value();
  EXPECT_EQ(member, registry_->member(user, now_).value());
  // The same certificate in other bytes: more text behind the PEM block is another serialized identity.
  const std::string pem = user_of(ca_, "User2@org1", "client").certificate_pem;
  for (int i = 0; i < 1100; ++i)
    ASSERT_TRUE(registry_->member(serialized("Org1MSP", pem + std::to_string(i) + "\n"), now_));
  EXPECT_EQ(registry_->member(user, now_).value()->name, member->name);
}

TEST(Certificates, SayWhatCryptogensSay) {
  const auto ca = make_ca("tlsca.org1.ledgerline", "org1.ledgerline").value();
  const auto server = issue(ca, {.common_name = "peer0.org1.ledgerline",
                                 .organization = "",
                                 .unit = std::nullopt,
                                 .sans = {"localhost", "127.0.0.1"},
                                 .tls = true})
                          .value();
  const std::string dir = testing::TempDir() + "certificates" + std::to_string(::getpid());
  fs::create_directories(dir);
  std::ofstream(dir + "/ca.pem") << ca.certificate_pem;
  std::ofstream(dir + "/server.pem") << server.certificate_pem;
  // An independent reader: the openssl command.
  const auto run = [&](const std::string& arguments) {
    std::string out;
    FILE* pipe = ::popen(("cd " + dir + " && openssl " + arguments + " 2>&1").c_str(), "r");
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) out.push_back(static_cast<char>(c));
    return ::pclose(pipe) == 0 ? out : "failed: " + out;
  };
  EXPECT_EQ(run("verify -x509_strict -CAfile ca.pem -purpose sslserver -verify_ip 127.0.0.1 server.pem"),
            "server.pem: OK\n");
  EXPECT_EQ(run("verify -x509_strict -CAfile ca.pem -purpose sslserver -verify_hostname localhost server.pem"),
            "server.pem: OK\n");
  const std::string text = run("x509 -in ca.pem -noout -text");
  for (const char* wanted :
       {"CA:TRUE", "Certificate Sign", "CRL Sign", "Subject Key Identifier", "ecdsa-with-SHA256", "prime256v1"}) {
    EXPECT_NE(text.find(wanted), std::string::npos) << wanted << " in\n" << text;
  }
  const std::string server_text = run("x509 -in server.pem -noout -text");
  for (const char* wanted :
       {"Authority Key Identifier", "DNS:localhost", "IP Address:127.0.0.1", "TLS Web Server Authentication"}) {
    EXPECT_NE(server_text.find(wanted), std::string::npos) << wanted << " in\n" << server_text;
  }
  fs::remove_all(dir);
}

TEST(Certificates, SubjectsAreRfc2253) {
  // Made by `openssl req -x509 -subj "/C=US/ST=California/L=San Francisco/OU=client/OU=drones,
  // small/CN=User1@org1.example.com"`.
  constexpr char pem[] =
      "-----BEGIN CERTIFICATE-----\n"
      "MIICYjCCAgegAwIBAgIUUoGbqtP/AUxdIDfrQblfaq3aE1cwCgYIKoZIzj0EAwIw\n"
      "gYQxCzAJBgNVBAYTAlVTMRMwEQYDVQQIDApDYWxpZm9ybmlhMRYwFAYDVQQHDA1T\n"
      "YW4gRnJhbmNpc2NvMQ8wDQYDVQQLDAZjbGllbnQxFjAUBgNVBAsMDWRyb25lcywg\n"
      "c21hbGwxHzAdBgNVBAMMFlVzZXIxQG9yZzEuZXhhbXBsZS5jb20wIBcNMjYxMTIx\n"
      "MTIwMDQ1WhgPMjEyNjEwMjgxMjAwNDVaMIGEMQswCQYDVQQGEwJVUzETMBEGA1UE\n"
      "CAwKQ2FsaWZvcm5pYTEWMBQGA1UEBwwNU2FuIEZyYW5jaXNjbzEPMA0GA1UECwwG\n"
      "Y2xpZW50MRYwFAYDVQQLDA1kcm9uZXMsIHNtYWxsMR8wHQYDVQQDDBZVc2VyMUBv\n"
      "cmcxLmV4YW1wbGUuY29tMFkwEwYHKoZIzj0CAQYIKoZIzj0DAQcDQgAEihRhh9xP\n"
      "9HzjKvIevhcu8e4vqs738jiUhbUjMPYODdg4Isvej6/maUNYrotwygMo/Ud1Shot\n"
      "OKMCvEVdOmwGOKNTMFEwHQYDVR0OBBYEFAz+lPSPyxwvj2XE7fNBNTc1HwwGMB8G\n"
      "A1UdIwQYMBaAFAz+lPSPyxwvj2XE7fNBNTc1HwwGMA8GA1UdEwEB/wQFMAMBAf8w\n"
      "CgYIKoZIzj0EAwIDSQAwRgIhAJOEizXu8wHbBrfvUdpjjkRAfscA+m30xK+D3C1m\n"
      "IqOCAiEA4xF1WmAGeWf9v0fRInQYQQwGBSdDrQpuhZupUGXwTcA=\n"
      "-----END CERTIFICATE-----\n";
  const auto certificate = parse_certificate(pem).value();
  EXPECT_EQ(certificate.subject,
            "CN=User1@org1.example.com,OU=drones\\, small,OU=client,L=San Francisco,ST=California,C=US");
  EXPECT_EQ(certificate.common_name, "User1@org1.example.com");
  EXPECT_EQ(certificate.units, (std::vector<std::string>{"client", "drones, small"}));
  EXPECT_EQ(certificate.not_after_s - certificate.not_before_s, 36500LL * 86400);
}

class LoadIdentity : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = testing::TempDir() + "msp" + std::to_string(::getpid());
    fs::create_directories(dir_ + "/signcerts");
    fs::create_directories(dir_ + "/keystore");
    write(user_.certificate_pem, user_.key_pem);
  }
  void TearDown() override { fs::remove_all(dir_); }
  void write(const std::string& certificate, const std::string& key) {
    std::ofstream(dir_ + "/signcerts/User1@test-cert.pem") << certificate;
    std::ofstream(key_file()) << key;
    ::chmod(key_file().c_str(), 0600);
  }
  std::string key_file() const { return dir_ + "/keystore/priv_sk"; }
  std::string error() const {
    auto identity = load_identity(Library::mbedtls, "Org1MSP", dir_);
    return identity ? "loaded" : identity.error().message;
  }

  KeyAndCertificate ca_ = make_ca("ca.test", "test").value();
  KeyAndCertificate user_ = user_of(ca_, "User1@test", "client");
  std::string dir_;
};

TEST_F(LoadIdentity, SignsInItsName) {
  for (const Library library : {Library::mbedtls, Library::libcrypto}) {
    const auto identity = load_identity(library, "Org1MSP", dir_).value();
    const auto registry = make_msp_registry(Library::libcrypto, {{"Org1MSP", ca_.certificate_pem}});
    const auto member = registry->member(identity.serialized, std::time(nullptr)).value();
    EXPECT_EQ(member->name, identity.name);
    EXPECT_TRUE(member->verifier->verify("m", identity.signer->sign("m").value()));
  }
}

TEST_F(LoadIdentity, RefusesAKeyThatOthersMayRead) {
  for (const mode_t mode : {0660, 0604, 0620, 0601}) {
    ::chmod(key_file().c_str(), mode);
    EXPECT_NE(error().find("chmod 600 " + key_file()), std::string::npos) << error();
  }
  ::chmod(key_file().c_str(), 0400);
  EXPECT_EQ(error(), "loaded");
}

TEST_F(LoadIdentity, TakesTheKeyUnderTheNamesThatToolsGiveIt) {
  const auto rename = [&](const std::string& from, const std::string& to) {
    fs::rename(dir_ + "/keystore/" + from, dir_ + "/keystore/" + to);
  };
  rename("priv_sk", "priv-key.pem");  // fablo
  std::ofstream(dir_ + "/keystore/notes.txt") << "x";
  EXPECT_EQ(error(), "loaded");
  rename("priv-key.pem", "key.pem");
  EXPECT_NE(error().find("has 2 files, none of them *_sk"), std::string::npos) << error();
  fs::remove(dir_ + "/keystore/notes.txt");
  EXPECT_EQ(error(), "loaded") << "the only one";
}

TEST_F(LoadIdentity, TakesAKubernetesSecretWithItsLinks) {
  const std::string secret = dir_ + "/keystore", data = secret + "/..2026_11_26";
  fs::create_directories(data);
  fs::rename(key_file(), data + "/tls.key");
  fs::create_directory_symlink("..2026_11_26", secret + "/..data");
  fs::create_symlink("..data/tls.key", secret + "/tls.key");
  EXPECT_EQ(error(), "loaded");
  ::chmod((data + "/tls.key").c_str(), 0444);
  EXPECT_NE(error().find("may be read by others"), std::string::npos) << "the file behind the link counts: " << error();
}

TEST_F(LoadIdentity, TwoFilesAreAnIdentityToo) {
  const IdentityFiles files{dir_ + "/signcerts/User1@test-cert.pem", key_file()};
  EXPECT_EQ(load_identity(Library::libcrypto, "Org1MSP", files).value().name.subject, "CN=User1@test,OU=client");
  ::chmod(key_file().c_str(), 0644);
  EXPECT_FALSE(load_identity(Library::libcrypto, "Org1MSP", files));
  EXPECT_FALSE(read_key_file(key_file()));
}

TEST_F(LoadIdentity, ALockedKeyNeedsItsPassPhraseAndAnOpenOneIsRefused) {
  const auto load = [&](const std::string& phrase) {
    auto identity = load_locked_identity(Library::mbedtls, "Org1MSP", dir_, phrase);
    return identity ? "loaded" : identity.error().message;
  };
  EXPECT_NE(load("open").find("not locked"), std::string::npos) << "anybody who reads the disk could sign with it";
  const std::string locked = lock_key(user_.key_pem, "open sesame").value();
  EXPECT_NE(locked.find("BEGIN ENCRYPTED PRIVATE KEY"), std::string::npos);
  write(user_.certificate_pem, locked);
  EXPECT_EQ(load("open sesame"), "loaded");
  EXPECT_NE(load("open").find("another pass phrase"), std::string::npos) << load("open");
  EXPECT_NE(load(""), "loaded");
  EXPECT_NE(error(), "loaded") << "nobody is asked at the terminal";
  EXPECT_EQ(read_identity_name("Org1MSP", dir_).value().subject, parse_certificate(user_.certificate_pem)->subject);
}

TEST_F(LoadIdentity, SaysWhatIsMissing) {
  fs::remove(key_file());
  EXPECT_NE(error().find("keystore has no file *_sk"), std::string::npos) << error();
  fs::remove_all(dir_ + "/signcerts");
  EXPECT_NE(error().find("signcerts"), std::string::npos) << error();
}

TEST_F(LoadIdentity, RefusesAKeyOfAnotherCertificate) {
  write(user_.certificate_pem, user_of(ca_, "User1@test", "client").key_pem);
  EXPECT_NE(error().find("does not belong"), std::string::npos) << error();
}

TEST_F(LoadIdentity, NeverPrintsTheKey) {
  write(user_.certificate_pem, "-----BEGIN PRIVATE KEY-----\nc2VjcmV0\n-----END PRIVATE KEY-----\n");
  EXPECT_EQ(error().find("c2VjcmV0"), std::string::npos) << error();
}

TEST(TestIdentity, SignsDeterministicallyAndIsChecked) {
  const auto operator_ = make_test_identity({"Org2MSP", "CN=User1@org2"});
  const auto registry = make_test_registry({"Org1MSP", "Org2MSP"});
  const auto member = registry->member(operator_.serialized, 0).value();
  const std::string signature = operator_.signer->sign("m").value();
  EXPECT_EQ(signature, make_test_identity({"Org2MSP", "CN=User1@org2"}).signer->sign("m").value());
  EXPECT_TRUE(member->verifier->verify("m", signature));
  EXPECT_FALSE(member->verifier->verify("n", signature));
  EXPECT_FALSE(
      member->verifier->verify("m", make_test_identity({"Org1MSP", "CN=User1@org2"}).signer->sign("m").value()));
  EXPECT_FALSE(registry->member(make_test_identity({"Org3MSP", "CN=x"}).serialized, 0));
  EXPECT_TRUE(registry->member(make_test_identity({"Org1MSP", "CN=Admin@org1"}).serialized, 0).value()->admin);
}

}  // namespace
}  // namespace ledgerline::crypto
