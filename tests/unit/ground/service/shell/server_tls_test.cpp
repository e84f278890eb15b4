#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <atomic>
#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <mutex>
#include <thread>

#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"
#include "common/web/tls.hpp"
#include "ground/service/core/connection_quota.hpp"
#include "ground/service/shell/server.hpp"
#include "tests/fuzz/directory.hpp"

namespace ledgerline::ground::service {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
namespace ssl = boost::asio::ssl;
using boost::asio::ip::tcp;
using testing::HasSubstr;
using Answer = http::response<http::string_body>;
using Secure = ssl::stream<tcp::socket>;

constexpr TimeNs renewal_limit_ns = 10 * ns_per_s;  // of a busy host; the server looks each second

class StationServerWithTls : public testing::Test {
 protected:
  StationServerWithTls() {
    const std::string folder = directory.path + "/";
    settings = {.listen = "127.0.0.1:0",
                .token_file = folder + "token",
                .tls = {folder + "cert.pem", folder + "key.pem", ""},
                .names = {"ground.example.org"},
                .session_idle_ns = 60 * ns_per_s};
    EXPECT_TRUE(write_file(folder + "ca.pem", authority.certificate_pem));
    write_own(issue(authority));
  }
  void start() {
    auto started = Server::start(settings, {"tello1"}, {},
                                 {.take =
                                      [this](const PilotCommand&) {
                                        ++heard;
                                        return Status(done);
                                      },
                                  .report =
                                      [this](Level level, const std::string& words) {
                                        const std::lock_guard lock(mutex);
                                        reported.emplace_back(level, words);
                                      }});
    ASSERT_TRUE(started) << started.error().message;
    server = std::move(*started);
    const std::string url = server->url();
    EXPECT_THAT(url, testing::StartsWith("https://ground.example.org:"));
    port = static_cast<std::uint16_t>(std::stoi(url.substr(url.rfind(':') + 1)));
    place = "ground.example.org:" + std::to_string(port);
    token = read_file(settings.token_file)->substr(0, token_digits);
  }

  static crypto::KeyAndCertificate issue(const crypto::KeyAndCertificate& by) {
    return *crypto::issue(
        by, {.common_name = "g", .organization = "O", .unit = {}, .sans = {"ground.example.org"}, .tls = true});
  }
  void write_own(const crypto::KeyAndCertificate& one) {
    EXPECT_TRUE(replace_file(settings.tls.certificate, one.certificate_pem));
    EXPECT_TRUE(replace_file(settings.tls.key, one.key_pem, 0600));
  }
  /// Of a client that trusts the authority, and has that certificate.
  web::TlsContext client(const std::optional<crypto::KeyAndCertificate>& own = {}) {
    web::TlsFiles files{.authority = directory.path + "/ca.pem"};
    if (own) {
      files.certificate = directory.path + "/client.pem";
      files.key = directory.path + "/client.key";
      EXPECT_TRUE(replace_file(files.certificate, own->certificate_pem));
      EXPECT_TRUE(replace_file(files.key, own->key_pem, 0600));
    }
    return *web::client_tls(files);
  }

  tcp::socket dial() {
    tcp::socket socket(io);
    socket.connect({boost::asio::ip::make_address_v4("127.0.0.1"), port});
    return socket;
  }
  Secure secure(const web::TlsContext& context) {
    Secure stream(dial(), *context);
    web::expect_host(stream.native_handle(), "ground.example.org");
    stream.handshake(ssl::stream_base::client);
    return stream;
  }
  template <typename Stream>
  Answer ask(Stream& stream, const std::string& target, const std::string& host, const std::string& origin = "",
             http::verb verb = http::verb::get) {
    http::request<http::empty_body> request{verb, target, 11};
    request.set(http::field::host, host);
    request.set(http::field::authorization, "Bearer " + token);
    if (!origin.empty()) request.set(http::field::origin, origin);
    request.prepare_payload();
    http::write(stream, request);
    beast::flat_buffer buffer;
    Answer answer;
    http::read(stream, buffer, answer);
    return answer;
  }
  unsigned status(const std::string& host, const std::string& origin = "") {
    Secure stream = secure(client());
    return ask(stream, "/api/v1/drones", host, origin).result_int();
  }
  /// Waits for what the server tells next.
  std::pair<Level, std::string> next_reported() {
    for (const TimeNs until = monotonic_ns() + renewal_limit_ns; monotonic_ns() < until;) {
      {
        const std::lock_guard lock(mutex);
        if (reported.size() > read_of_reported) return reported[read_of_reported++];
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return {Level::alarm, "nothing"};
  }
  static std::string serial_of(Secure& stream) {
    const std::unique_ptr<X509, decltype(&X509_free)> shown(SSL_get1_peer_certificate(stream.native_handle()),
                                                            X509_free);
    const ASN1_INTEGER* serial = X509_get0_serialNumber(shown.get());
    return {reinterpret_cast<const char*>(serial->data), static_cast<std::size_t>(serial->length)};
  }

  fuzz::Directory directory;
  const crypto::KeyAndCertificate authority = *crypto::make_ca("ca", "Org"), other = *crypto::make_ca("other", "Org");
  boost::asio::io_context io;
  ServiceSettings settings;
  std::mutex mutex;
  std::vector<std::pair<Level, std::string>> reported;
  std::size_t read_of_reported = 0;
  std::atomic<int> heard{0};
  std::unique_ptr<Server> server;
  std::uint16_t port = 0;
  std::string place, token;
};

TEST_F(StationServerWithTls, IsReachedByItsNamesOverHttpsAlone) {
  start();
  const std::string port_text = ":" + std::to_string(port);
  for (const std::string host : {"ground.example.org", "127.0.0.1", "localhost"})
    EXPECT_EQ(status(host + port_text, "https://" + host + port_text), 200U) << host;
  EXPECT_EQ(status("evil.example" + port_text), 403U);
  EXPECT_EQ(status("ground.example.org"), 403U) << "the port belongs to it";
  EXPECT_EQ(status(place, "http://" + place), 403U) << "a page without TLS may be anybody's";
  tcp::socket plain = dial();
  const Answer refused = ask(plain, "/api/v1/stop", place, "", http::verb::post);
  EXPECT_EQ(refused.result_int(), 400U);
  EXPECT_THAT(refused.body(), HasSubstr("https://"));
  EXPECT_EQ(heard, 0);
}

TEST_F(StationServerWithTls, InstructsBrowsersToStayWithHttpsButNotOfLocalhost) {
  start();
  Secure by_name = secure(client());
  const Answer page = ask(by_name, "/", place);
  EXPECT_EQ(page.result_int(), 200U);
  EXPECT_EQ(page["Strict-Transport-Security"], "max-age=2592000");
  Secure by_localhost = secure(client());
  EXPECT_EQ(ask(by_localhost, "/", "localhost:" + std::to_string(port))["Strict-Transport-Security"], "");
}

TEST_F(StationServerWithTls, ShowsItsStreamToo) {
  start();
  beast::websocket::stream<Secure> stream(secure(client()));
  stream.set_option(beast::websocket::stream_base::decorator([&](beast::websocket::request_type& request) {
    request.set(http::field::sec_websocket_protocol, "ledgerline.v1, token." + token);
  }));
  stream.handshake(place, "/api/v1/stream");
  const auto read = [&] {
    beast::flat_buffer buffer;
    stream.read(buffer);
    return beast::buffers_to_string(buffer.data());
  };
  EXPECT_THAT(read(), HasSubstr("hello"));
  server->publish({.drones = "[]", .state = R"({"op":"state"})"});
  EXPECT_THAT(read(), HasSubstr("state"));
  std::jthread ending([&] { server->end(); });
  EXPECT_THROW(read(), std::exception);
  EXPECT_EQ(stream.reason().code, beast::websocket::close_code::going_away);
}

TEST_F(StationServerWithTls, OfBothSidesServesNobodyWithoutACertificateOfItsAuthority) {
  settings.tls.authority = directory.path + "/ca.pem";
  start();
  Secure known = secure(client(issue(authority)));
  EXPECT_EQ(ask(known, "/api/v1/stop", place, "", http::verb::post).result_int(), 202U);
  EXPECT_EQ(heard, 1);
  for (const auto& own : {std::optional<crypto::KeyAndCertificate>(), std::optional(issue(other))}) {
    // In TLS 1.3 a client hears of it behind its own last word of the handshake.
    EXPECT_THROW(
        {
          Secure other = secure(client(own));
          ask(other, "/api/v1/stop", place, "", http::verb::post);
        },
        std::exception);
  }
  EXPECT_EQ(heard, 1);
}

TEST_F(StationServerWithTls, HandshakesThatDoNotEndKeepNobodyOut) {
  start();
  std::vector<tcp::socket> silent, half;
  const std::string hello("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", 11);  // a ClientHello's first bytes
  for (std::size_t i = 0; i < max_unauthenticated / 2 + 50; ++i) {
    silent.push_back(dial());
    half.push_back(dial());
    beast::error_code gone;  // as soon as there are enough of them
    boost::asio::write(half.back(), boost::asio::buffer(hello), gone);
  }
  Secure stream = secure(client());
  EXPECT_EQ(ask(stream, "/api/v1/stop", place, "", http::verb::post).result_int(), 202U);
  EXPECT_EQ(heard, 1);
}

TEST_F(StationServerWithTls, TakesARenewedCertificateAndKeepsTheOldOneWhereItIsBad) {
  start();
  Secure before = secure(client());
  const auto next = issue(authority);
  write_own(next);
  EXPECT_EQ(next_reported(), std::pair(Level::info, std::string("ground's page has a new TLS certificate")));
  Secure after = secure(client());
  EXPECT_NE(serial_of(before), serial_of(after));
  EXPECT_EQ(ask(before, "/api/v1/drones", place).result_int(), 200U) << "who is connected stays so";
  ASSERT_TRUE(replace_file(settings.tls.key, issue(authority).key_pem, 0600));
  const auto [level, words] = next_reported();
  EXPECT_EQ(level, Level::warning);
  EXPECT_THAT(words, HasSubstr("keeps its old TLS certificate: " + settings.tls.key));
  Secure still = secure(client());
  EXPECT_EQ(serial_of(still), serial_of(after));
}

TEST_F(StationServerWithTls, SaysThatItsCertificateRunsOut) {
  const auto issued_for = [&](int days) {
    return *crypto::issue(authority,
                          {.common_name = "g", .organization = "O", .unit = {}, .sans = {}, .tls = true, .days = days});
  };
  write_own(issued_for(10));
  start();
  EXPECT_THAT(next_reported().second, HasSubstr("runs out in 9 days"));
  write_own(issued_for(-1));
  EXPECT_THAT(next_reported().second, HasSubstr("keeps its old TLS certificate: it has ended already"));
  server.reset();
  start();
  EXPECT_THAT(next_reported().second, HasSubstr("has run out"));
}

TEST_F(StationServerWithTls, OfEveryAddressTakesIpv4AndIpv6) {
  settings.listen = "[::]:0";
  boost::system::error_code error;
  tcp::socket tried(io);
  tried.open(tcp::v6(), error);
  if (error) GTEST_SKIP() << "this host has no IPv6";
  start();
  EXPECT_EQ(status("127.0.0.1:" + std::to_string(port)), 200U);
  tcp::socket socket(io);
  socket.connect({boost::asio::ip::address_v6::loopback(), port}, error);
  if (error) GTEST_SKIP() << "this host has no IPv6 loopback";
  Secure stream(std::move(socket), *client());
  stream.handshake(ssl::stream_base::client);
  EXPECT_EQ(ask(stream, "/api/v1/drones", "[::1]:" + std::to_string(port)).result_int(), 200U);
}

TEST_F(StationServerWithTls, DoesNotStartWithAKeyThatOthersMayRead) {
  ASSERT_EQ(::chmod(settings.tls.key.c_str(), 0644), 0);
  const auto refused = Server::start(settings, {}, {}, {.take = [](const PilotCommand&) { return Status(done); }});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("chmod 600"));
}

}  // namespace
}  // namespace ledgerline::ground::service
