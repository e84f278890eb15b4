#include "ground/service/core/guard.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::ground::service {
namespace {

using testing::HasSubstr;
using testing::UnorderedElementsAre;

ServiceSettings plain(const std::string& listen) { return {.listen = listen, .token_file = "token"}; }
ServiceSettings with_tls(const std::string& listen, std::vector<std::string> names = {}) {
  return {.listen = listen, .token_file = "token", .tls = {"cert.pem", "key.pem", ""}, .names = std::move(names)};
}
/// "key what" of the only error; empty: there is none.
std::string error_of(const ServiceSettings& settings) {
  const auto errors = errors_of(settings);
  EXPECT_LE(errors.size(), 1U);
  return errors.empty() ? "" : errors[0].key + " " + errors[0].what;
}

TEST(ServiceSettings, WithoutTlsAreOfThisComputerAlone) {
  for (const char* listen : {"127.0.0.1:8800", "127.1.2.3:0", "[::1]:8800"}) EXPECT_EQ(error_of(plain(listen)), "");
  for (const char* listen : {"0.0.0.0:8800", "10.0.0.1:8800", "[::]:8800", "[fd00::7]:8800"})
    EXPECT_THAT(error_of(plain(listen)), HasSubstr("set tls_certificate and tls_key, or take an SSH tunnel")) << listen;
  for (const char* listen : {"127.0.0.1", "127.0.0.1:65536", "127.0.0.1:x", "localhost:8800"})
    EXPECT_THAT(error_of(plain(listen)), HasSubstr("listen must")) << listen;
  ServiceSettings named = plain("127.0.0.1:8800");
  named.names = {"ground.example.org"};
  EXPECT_THAT(error_of(named), HasSubstr("names must not be there without tls_certificate"));
}

TEST(ServiceSettings, WithTlsAreOfAnyAddressAndSayItsNames) {
  EXPECT_EQ(error_of(with_tls("10.0.0.1:8800")), "");
  EXPECT_EQ(error_of(with_tls("0.0.0.0:8800", {"ground.example.org", "10.0.0.1", "fd00::7"})), "");
  for (const char* listen : {"0.0.0.0:8800", "[::]:8800"})
    EXPECT_THAT(error_of(with_tls(listen)), HasSubstr("names must say by which names")) << listen;
  for (const char* name : {"Ground.example.org", "ground.example.org:8800", "https://ground.example.org", "[fd00::7]",
                           "*.example.org", "0.0.0.0", ""})
    EXPECT_THAT(error_of(with_tls("10.0.0.1:8800", {name})), HasSubstr("names must be")) << name;
}

TEST(ServiceSettings, OfTlsGoTogether) {
  ServiceSettings half = with_tls("127.0.0.1:8800");
  half.tls.key = "";
  EXPECT_EQ(error_of(half), "tls_key must be there with tls_certificate");
  half = plain("127.0.0.1:8800");
  half.tls.key = "key.pem";
  EXPECT_EQ(error_of(half), "tls_certificate must be there with tls_key");
  half.tls = {.authority = "ca.pem"};
  EXPECT_EQ(error_of(half), "tls_client_ca must not be there without tls_certificate");
  half = plain("127.0.0.1:8800");
  half.faults = std::string(108, 'x');
  EXPECT_EQ(error_of(half), "faults must be a path of at most 107 bytes");
  half = plain("127.0.0.1:8800");
  half.token_file = "";
  EXPECT_THAT(error_of(half), HasSubstr("token_file must name a file"));
}

TEST(ServiceSettings, SayWhatHostMayBe) {
  EXPECT_THAT(hosts_of(plain("127.0.0.1:0"), 8800), UnorderedElementsAre("localhost:8800", "127.0.0.1:8800"));
  EXPECT_THAT(hosts_of(with_tls("10.0.0.1:8800", {"ground.example.org"}), 8800),
              UnorderedElementsAre("ground.example.org:8800", "localhost:8800", "10.0.0.1:8800"));
  EXPECT_THAT(hosts_of(with_tls("[::]:8800", {"fd00::7"}), 8800),
              UnorderedElementsAre("[fd00::7]:8800", "localhost:8800", "127.0.0.1:8800", "[::1]:8800"))
      << "every address is none that a page is reached by";
  EXPECT_THAT(hosts_of(plain("127.0.0.1:443"), 443), UnorderedElementsAre("localhost:443", "127.0.0.1:443"));
  EXPECT_THAT(hosts_of(with_tls("10.0.0.1:443"), 443),
              UnorderedElementsAre("localhost:443", "localhost", "10.0.0.1:443", "10.0.0.1"));
}

TEST(ServiceSettings, SayWhereABrowserFindsThePage) {
  EXPECT_EQ(url_of(plain("127.0.0.1:0"), 8800), "http://127.0.0.1:8800");
  EXPECT_EQ(url_of(with_tls("[fd00::7]:0"), 8800), "https://[fd00::7]:8800");
  EXPECT_EQ(url_of(with_tls("0.0.0.0:0", {"ground.example.org", "10.0.0.1"}), 8800), "https://ground.example.org:8800");
}

}  // namespace
}  // namespace ledgerline::ground::service
