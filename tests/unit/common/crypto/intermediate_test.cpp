#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <ctime>
#include <filesystem>

#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"
#include "msp/identities.pb.h"

namespace ledgerline::crypto {
namespace {

/// An organisation as openssl makes it: a root, an authority below it, a user of that one, all on P-384, signed over
/// SHA-384; and that authority's revocation lists.
class Intermediate : public testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::create_directories(dir_);
    const std::string authority =
        "basicConstraints=critical,CA:TRUE\nkeyUsage=critical,keyCertSign,cRLSign\nsubjectKeyIdentifier=hash\n";
    ASSERT_TRUE(write_file(dir_ + "/ca.ext", authority));
    ASSERT_TRUE(write_file(dir_ + "/user.ext", "keyUsage=critical,digitalSignature\nauthorityKeyIdentifier=keyid\n"));
    ASSERT_TRUE(write_file(dir_ + "/ca.cnf",
                           "[ca]\ndefault_ca=x\n[x]\ndatabase=index\ncrlnumber=number\ndefault_md=sha384\n"
                           "default_crl_days=30\ncrl_extensions=e\n[e]\nauthorityKeyIdentifier=keyid\n"));
    ASSERT_TRUE(write_file(dir_ + "/index", ""));
    ASSERT_TRUE(write_file(dir_ + "/number", "01\n"));
    make("root", "/CN=ca.org2", "-signkey root.key", "ca.ext");
    make("middle", "/CN=ica.org2", "-CA root.pem -CAkey root.key -CAcreateserial", "ca.ext");
    make("user", "/OU=client/CN=User1@org2", "-CA middle.pem -CAkey middle.key -CAcreateserial", "user.ext");
  }
  void TearDown() override { std::filesystem::remove_all(dir_); }

  void run(const std::string& command) const {
    ASSERT_EQ(std::system(("cd " + dir_ + " && " + command + " >>log 2>&1").c_str()), 0) << *read_file(dir_ + "/log");
  }
  void make(const std::string& name, const std::string& subject, const std::string& by, const std::string& extensions) {
    run("openssl ecparam -name secp384r1 -genkey -noout -out " + name + ".key");
    run("openssl req -new -key " + name + ".key -subj " + subject + " -out " + name + ".csr");
    run("openssl x509 -req -sha384 -days 30 -in " + name + ".csr " + by + " -extfile " + extensions + " -out " + name +
        ".pem");
  }
  std::string pem(const std::string& name) const { return read_file(dir_ + "/" + name).value(); }

  std::string verdict(Library library, const std::string& authorities, const std::string& lists = "") const {
    msp::SerializedIdentity identity;
    identity.set_mspid("Org2MSP");
    identity.set_id_bytes(pem("user.pem"));
    const auto registry = make_msp_registry(library, {{"Org2MSP", authorities, lists}});
    const auto member = registry->member(identity.SerializeAsString(), std::time(nullptr));
    if (!member) return member.error().message;
    const auto signature = make_signer(library, pem("user.key")).value()->sign("message").value();
    return (*member)->verifier->verify("message", signature) ? "signs" : "does not sign";
  }

  const std::string dir_ = testing::TempDir() + "intermediate" + std::to_string(::getpid());
};

TEST_F(Intermediate, AUserBelowAnAuthorityBelowARootOnP384Signs) {
  for (const Library library : {Library::mbedtls, Library::libcrypto}) {
    EXPECT_EQ(verdict(library, pem("root.pem") + pem("middle.pem")), "signs");
    EXPECT_NE(verdict(library, pem("root.pem")).find("unknown authority"), std::string::npos);
    EXPECT_NE(verdict(library, pem("middle.pem")).find("unknown authority"), std::string::npos) << "no root";
  }
}

TEST_F(Intermediate, ItsRevocationListCounts) {
  const std::string both = pem("root.pem") + pem("middle.pem");
  const std::string by_middle = "openssl ca -config ca.cnf -cert middle.pem -keyfile middle.key ";
  run(by_middle + "-gencrl -out empty.crl");
  EXPECT_EQ(verdict(Library::libcrypto, both, pem("empty.crl")), "signs");
  run(by_middle + "-revoke user.pem");
  run(by_middle + "-gencrl -out list.crl");
  EXPECT_NE(verdict(Library::libcrypto, both, pem("list.crl")).find("has been revoked"), std::string::npos);
}

}  // namespace
}  // namespace ledgerline::crypto
