#include "common/web/tls.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openssl/ssl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"
#include "tests/fuzz/directory.hpp"

namespace ledgerline::web {
namespace {

using testing::HasSubstr;

class TlsFromFiles : public testing::Test {
 protected:
  TlsFromFiles() {
    EXPECT_TRUE(write_file(files.authority, authority.certificate_pem));
    write(issue());
  }
  crypto::KeyAndCertificate issue() {
    return *crypto::issue(authority,
                          {.common_name = "ground", .organization = "Org", .unit = {}, .sans = {}, .tls = true});
  }
  void write(const crypto::KeyAndCertificate& one) {
    EXPECT_TRUE(replace_file(files.certificate, one.certificate_pem));
    EXPECT_TRUE(replace_file(files.key, one.key_pem, 0600));
  }
  std::string refused() { return server_tls(files).error().message; }

  fuzz::Directory directory;
  const crypto::KeyAndCertificate authority = *crypto::make_ca("ca", "Org");
  TlsFiles files{directory.path + "/cert.pem", directory.path + "/key.pem", directory.path + "/ca.pem"};
};

TEST_F(TlsFromFiles, IsOneDotTwoAtLeastAndKeepsNoSessions) {
  for (const auto& context : {server_tls(files), client_tls(files)}) {
    ASSERT_TRUE(context) << context.error().message;
    SSL_CTX* const native = (*context)->native_handle();
    EXPECT_EQ(SSL_CTX_get_min_proto_version(native), TLS1_2_VERSION);
    EXPECT_EQ(SSL_CTX_get_session_cache_mode(native), SSL_SESS_CACHE_OFF);
    EXPECT_TRUE(SSL_CTX_get_options(native) & SSL_OP_NO_TICKET);
    EXPECT_TRUE(SSL_CTX_get_options(native) & SSL_OP_NO_RENEGOTIATION);
    EXPECT_TRUE(SSL_CTX_get_verify_mode(native) & SSL_VERIFY_PEER);
  }
}

TEST_F(TlsFromFiles, RefusesAKeyThatOthersMayRead) {
  ASSERT_EQ(::chmod(files.key.c_str(), 0644), 0);
  EXPECT_THAT(refused(), HasSubstr("chmod 600 " + files.key));
  EXPECT_THAT(client_tls(files).error().message, HasSubstr("chmod 600"));
}

TEST_F(TlsFromFiles, TakesAKeyThatRootGivesToAGroupOfOurs) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, as Kubernetes is when it mounts a secret";
  ASSERT_EQ(::chown(files.key.c_str(), 0, ::getegid()), 0);
  ASSERT_EQ(::chmod(files.key.c_str(), 0440), 0);
  EXPECT_TRUE(server_tls(files)) << refused();
}

TEST_F(TlsFromFiles, SaysWhichFileIsWrong) {
  const std::string good_key = *read_file(files.key);
  ASSERT_TRUE(replace_file(files.key, issue().key_pem, 0600));
  EXPECT_THAT(refused(), HasSubstr("not that of " + files.certificate));
  ASSERT_TRUE(replace_file(files.key, *crypto::lock_key(good_key, "phrase"), 0600));
  EXPECT_THAT(refused(), HasSubstr("without a pass phrase")) << "and does not ask for it";
  ASSERT_TRUE(replace_file(files.key, good_key, 0600));
  ASSERT_TRUE(replace_file(files.authority, "nothing"));
  EXPECT_THAT(refused(), HasSubstr(files.authority + " has no certificate"));
  ASSERT_TRUE(replace_file(files.certificate, good_key));
  EXPECT_THAT(refused(), HasSubstr(files.certificate + ": "));
  files.certificate = directory.path + "/none.pem";
  EXPECT_THAT(refused(), HasSubstr("none.pem"));
}

TEST_F(TlsFromFiles, IsRenewedWhenBothFilesAreNewAndStay) {
  auto tls = *RenewedTls::open(files);
  const auto* const first = &tls.context();
  EXPECT_FALSE(tls.renew());
  EXPECT_FALSE(tls.renew());
  const auto next = issue();
  ASSERT_TRUE(replace_file(files.certificate, next.certificate_pem));
  EXPECT_FALSE(tls.renew()) << "its key may be on its way";
  ASSERT_TRUE(replace_file(files.key, next.key_pem, 0600));
  EXPECT_FALSE(tls.renew());
  const auto news = tls.renew();
  ASSERT_TRUE(news && *news);
  EXPECT_NE(&tls.context(), first);
  EXPECT_FALSE(tls.renew()) << "said once";
}

TEST_F(TlsFromFiles, AreKeptWhereTheNewOnesAreBad) {
  auto tls = *RenewedTls::open(files);
  const auto* const first = &tls.context();
  ASSERT_TRUE(replace_file(files.certificate, issue().certificate_pem));
  EXPECT_FALSE(tls.renew());
  const auto news = tls.renew();
  ASSERT_TRUE(news && !*news);
  EXPECT_THAT(news->error().message, HasSubstr(files.key));
  EXPECT_FALSE(tls.renew()) << "said once";
  EXPECT_EQ(&tls.context(), first);
  ASSERT_EQ(std::remove(files.certificate.c_str()), 0);
  tls.renew();
  EXPECT_TRUE(tls.renew().has_value()) << "a file that is gone is news, too";
  EXPECT_EQ(&tls.context(), first);
  write(issue());
  tls.renew();
  const auto repaired = tls.renew();
  EXPECT_TRUE(repaired && *repaired);
}

}  // namespace
}  // namespace ledgerline::web
