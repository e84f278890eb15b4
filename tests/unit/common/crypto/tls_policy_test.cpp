#include "common/crypto/tls_policy.hpp"
#include "common/crypto/openssl.hpp"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openssl/err.h>
#include <sys/socket.h>
#include <unistd.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <csignal>
#include <future>
#include <thread>

#include "chaincode/endorser/shell/service.hpp"
#include "chaincode/shim/shim.hpp"
#include "common/base/file.hpp"
#include "common/fabric/client/connection.hpp"
#include "common/web/tls.hpp"
#include "ground/service/shell/server.hpp"
#include "tests/fuzz/directory.hpp"
#include "tests/unit/chaincode/node/server/served_node.hpp"
#include "tools/checks/shell/probes.hpp"

/// Every listener and every client against OpenSSL with one version and cipher alone.
namespace ledgerline::crypto {
namespace {

using ContextPtr = std::unique_ptr<SSL_CTX, Freed<SSL_CTX_free>>;
using SslPtr = std::unique_ptr<SSL, Freed<SSL_free>>;

/// What one side speaks, alone.
struct Speech {
  const char* name;
  int version;
  const char* ciphers;  ///< of TLS 1.2
  bool is_permitted;
};
constexpr Speech speeches[] = {
    {"TLS 1.3", TLS1_3_VERSION, "", true},
    {"TLS 1.2, AES-128-GCM", TLS1_2_VERSION, "ECDHE-ECDSA-AES128-GCM-SHA256", true},
    {"TLS 1.2, AES-256-GCM", TLS1_2_VERSION, "ECDHE-ECDSA-AES256-GCM-SHA384", true},
    {"TLS 1.2, ChaCha20", TLS1_2_VERSION, "ECDHE-ECDSA-CHACHA20-POLY1305", false},
    {"TLS 1.2, CBC", TLS1_2_VERSION, "ECDHE-ECDSA-AES128-SHA256:ECDHE-ECDSA-AES128-SHA", false},
    {"TLS 1.1", TLS1_1_VERSION, "ALL:@SECLEVEL=0", false},
    {"TLS 1.0", TLS1_VERSION, "ALL:@SECLEVEL=0", false},
};

ContextPtr context_of(const SSL_METHOD* method, const Speech& speech) {
  ContextPtr context(SSL_CTX_new(method));
  SSL_CTX_set_min_proto_version(context.get(), speech.version);
  SSL_CTX_set_max_proto_version(context.get(), speech.version);
  if (*speech.ciphers != 0) {
    EXPECT_EQ(SSL_CTX_set_cipher_list(context.get(), speech.ciphers), 1) << speech.name;
  }
  return context;
}

std::uint16_t port_of(const std::string& endpoint) {
  return static_cast<std::uint16_t>(std::stoi(endpoint.substr(endpoint.rfind(':') + 1)));
}

/// With an authority whose certificates listeners ask their clients for, and the files that they begin with.
class TlsPolicy : public testing::Test {
 protected:
  TlsPolicy() {
    std::signal(SIGPIPE, SIG_IGN);
    own_ = write("own", issue(authority_));
    client_ = write("client", issue(authority_));
    outsider_ = write("outsider", issue(*make_ca("other", "Org")));
    EXPECT_TRUE(write_file(authority_file_, authority_.certificate_pem));
  }
  static KeyAndCertificate issue(const KeyAndCertificate& by) {
    return *crypto::issue(
        by, {.common_name = "localhost", .organization = "O", .unit = {}, .sans = {"127.0.0.1"}, .tls = true});
  }
  IdentityFiles write(const std::string& name, const KeyAndCertificate& pair) const {
    IdentityFiles files{.certificate = directory_.path + "/" + name + ".pem",
                        .private_key = directory_.path + "/" + name + ".key"};
    EXPECT_TRUE(write_file(files.certificate, pair.certificate_pem));
    EXPECT_TRUE(write_file(files.private_key, pair.key_pem, 0600));
    return files;
  }
  static void use(SSL_CTX* context, const IdentityFiles& pair) {
    EXPECT_EQ(SSL_CTX_use_certificate_chain_file(context, pair.certificate.c_str()), 1);
    EXPECT_EQ(SSL_CTX_use_PrivateKey_file(context, pair.private_key.c_str(), SSL_FILETYPE_PEM), 1);
  }

  struct Listener {
    std::string name, hello;
    std::uint16_t port;
    std::shared_ptr<void> running;
    std::optional<IdentityFiles> client = {};  ///< where it asks for another authority's
  };
  /// All of them; `authorities`: a file of those of their clients, or none.
  std::vector<Listener> listeners(const std::string& authorities) {
    // RFC 9113, 3.4.
    const std::string http2("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\4\0\0\0\0\0", 33);
    std::vector<Listener> all;
    using node::ServedNode;
    auto node = std::make_shared<ServedNode>(
        ServedNode::settings(), authorities.empty() ? ServedNode::Clients::any : ServedNode::Clients::with_certificate);
    const std::filesystem::path user = node->tls_of_user("User1");
    const IdentityFiles of_user{user / "client.crt", user / "client.key"};
    all.push_back({"node", http2, port_of(node->endpoint()), node, of_user});
    all.push_back(endorser(*node, of_user, authorities, http2));

    auto chaincode = shim::Server::start({.chaincode_id = "c:1",
                                          .address = "127.0.0.1:0",
                                          .key_file = own_.private_key,
                                          .certificate_file = own_.certificate,
                                          .client_ca_file = authorities},
                                         {});
    EXPECT_TRUE(chaincode) << chaincode.error().message;
    const std::uint16_t chaincode_port = port_of((*chaincode)->endpoint());
    all.push_back({"chaincode", http2, chaincode_port, std::shared_ptr<shim::Server>(std::move(*chaincode))});

    auto station = ground::service::Server::start({.listen = "127.0.0.1:0",
                                                   .token_file = directory_.path + "/token",
                                                   .tls = {own_.certificate, own_.private_key, authorities},
                                                   .names = {"localhost"},
                                                   .session_idle_ns = 60 * ns_per_s},
                                                  {"tello1"}, {},
                                                  {.take = [](const ground::PilotCommand&) { return Status(done); },
                                                   .report = [](ground::service::Level, const std::string&) {}});
    EXPECT_TRUE(station) << station.error().message;
    const std::uint16_t station_port = port_of((*station)->url().substr(0, (*station)->url().find('/', 8)));
    all.push_back({"station", "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", station_port,
                   std::shared_ptr<ground::service::Server>(std::move(*station))});
    return all;
  }
  /// Of that node as its peer.
  Listener endorser(const node::ServedNode& node, const IdentityFiles& of_user, const std::string& authorities,
                    const std::string& hello) const {
    fabric::ClientConfig config;
    config.endpoint = node.endpoint();
    config.tls_ca_file = node.tls_ca_file();
    config.tls_pair = {of_user.certificate, of_user.private_key};
    config.orderers.push_back({node.endpoint(), node.tls_ca_file()});
    config.identity = node.user(1, "User1");
    const std::filesystem::path crypto = std::filesystem::path(node.tls_ca_file()).parent_path().parent_path();
    config.config_block = node::text_of(crypto.parent_path().parent_path().parent_path() / "teleop.block");
    struct Running {
      std::unique_ptr<endorser::Service> service;
      std::unique_ptr<endorser::Server> served;
    };
    auto running = std::make_shared<Running>();
    running->service = std::move(*endorser::Service::start(config, {}, [] {}));
    auto served = endorser::serve(*running->service, {"127.0.0.1:0", own_.certificate, own_.private_key, authorities},
                                  "serve.", nullptr);
    EXPECT_TRUE(served) << served.error().message;
    running->served = std::move(*served);
    return {"endorser", hello, port_of(running->served->endpoint()), running};
  }

  struct Outcome {
    bool is_served = false;  ///< answered: TLS 1.3 refuses a client's certificate behind the client's handshake
    bool is_asked = false;   ///< for a certificate
  };
  static Outcome connect(const Listener& to, const Speech& speech, const std::optional<IdentityFiles>& shown) {
    const ContextPtr context = context_of(TLS_client_method(), speech);
    if (shown) use(context.get(), *shown);
    const SslPtr ssl(SSL_new(context.get()));
    Outcome outcome;
    SSL_set_cert_cb(
        ssl.get(), [](SSL*, void* asked) { return *static_cast<bool*>(asked) = true, 1; }, &outcome.is_asked);
    constexpr unsigned char h2[] = {2, 'h', '2'};
    SSL_set_alpn_protos(ssl.get(), h2, sizeof h2);
    const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
    const timeval limit{10, 0};
    EXPECT_EQ(::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit), 0);
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_port = htons(to.port);
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(fd, reinterpret_cast<const sockaddr*>(&at), sizeof at), 0) << to.name;
    SSL_set_fd(ssl.get(), fd);
    ERR_clear_error();
    char answer[64];
    outcome.is_served = SSL_connect(ssl.get()) == 1 &&
                        SSL_write(ssl.get(), to.hello.data(), static_cast<int>(to.hello.size())) > 0 &&
                        SSL_read(ssl.get(), answer, sizeof answer) > 0;
    ::close(fd);
    return outcome;
  }

  fuzz::Directory directory_;
  const KeyAndCertificate authority_ = *make_ca("ca", "Org");
  const std::string authority_file_ = directory_.path + "/ca.pem";
  IdentityFiles own_, client_, outsider_;
};

TEST_F(TlsPolicy, ListenersSpeakThePermittedVersionsAndCiphersAlone) {
  for (const Listener& listener : listeners(authority_file_)) {
    for (const Speech& speech : speeches) {
      EXPECT_EQ(connect(listener, speech, listener.client.value_or(client_)).is_served, speech.is_permitted)
          << listener.name << " " << speech.name;
    }
  }
}

TEST_F(TlsPolicy, ListenersWithAuthoritiesServeTheirClientsAlone) {
  for (const Listener& listener : listeners(authority_file_)) {
    for (const Speech& speech : {speeches[0], speeches[1]}) {
      EXPECT_FALSE(connect(listener, speech, std::nullopt).is_served) << listener.name << " " << speech.name;
      EXPECT_FALSE(connect(listener, speech, outsider_).is_served) << listener.name << " " << speech.name;
    }
  }
}

TEST_F(TlsPolicy, ListenersWithoutAuthoritiesAskForNoCertificate) {
  for (const Listener& listener : listeners("")) {
    const Outcome outcome = connect(listener, speeches[0], std::nullopt);
    EXPECT_TRUE(outcome.is_served) << listener.name;
    EXPECT_FALSE(outcome.is_asked) << listener.name;
  }
}

/// Takes one connection of TLS as `speech` says.
class OneServer {
 public:
  OneServer(const Speech& speech, const IdentityFiles& own, void (*use)(SSL_CTX*, const IdentityFiles&))
      : context_(context_of(TLS_server_method(), speech)), fd_(::socket(AF_INET, SOCK_STREAM, 0)) {
    use(context_.get(), own);
    SSL_CTX_set_alpn_select_cb(
        context_.get(),
        [](SSL*, const unsigned char** out, unsigned char* size, const unsigned char* in, unsigned, void*) {
          *out = in + 1;
          *size = *in;
          return SSL_TLSEXT_ERR_OK;
        },
        nullptr);
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof at;
    EXPECT_EQ(::bind(fd_, reinterpret_cast<const sockaddr*>(&at), size), 0);
    EXPECT_EQ(::listen(fd_, 8), 0);
    EXPECT_EQ(::getsockname(fd_, reinterpret_cast<sockaddr*>(&at), &size), 0);
    port = ntohs(at.sin_port);
    met_ = std::async(std::launch::async, [this] {
      const int one = ::accept(fd_, nullptr, nullptr);
      const timeval limit{10, 0};
      ::setsockopt(one, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
      const SslPtr ssl(SSL_new(context_.get()));
      SSL_set_fd(ssl.get(), one);
      const bool is_met = SSL_accept(ssl.get()) == 1;
      ::close(one);
      return is_met;
    });
  }
  ~OneServer() { ::close(fd_); }
  OneServer(const OneServer&) = delete;
  OneServer& operator=(const OneServer&) = delete;
  bool is_over() const { return met_.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }
  /// Whether the two agreed.
  bool met() { return met_.get(); }
  std::string endpoint() const { return "127.0.0.1:" + std::to_string(port); }

  std::uint16_t port = 0;

 private:
  const ContextPtr context_;
  const int fd_;
  std::future<bool> met_;
};

TEST_F(TlsPolicy, ClientsSpeakThePermittedVersionsAndCiphersAlone) {
  for (const Speech& speech : speeches) {
    {
      OneServer server(speech, own_, use);
      boost::asio::io_context io;
      const auto context = *web::client_tls({.authority = authority_file_});
      boost::asio::ssl::stream<boost::asio::ip::tcp::socket> stream(io, *context);
      stream.next_layer().connect({boost::asio::ip::make_address_v4("127.0.0.1"), server.port});
      boost::system::error_code error;
      stream.handshake(boost::asio::ssl::stream_base::client, error);
      EXPECT_EQ(server.met(), speech.is_permitted) << "web " << speech.name;
    }
    {
      OneServer server(speech, own_, use);
      fabric::ClientConfig config;
      config.endpoint = server.endpoint();
      config.tls_ca_file = authority_file_;
      config.identity = make_test_identity({"Org1MSP", "CN=x"});
      const auto made = fabric::make_connection(std::move(config)).value();
      // gRPC connects while somebody waits for it.
      while (!server.is_over())
        made->channels()->peers.at(0)->WaitForConnected(std::chrono::system_clock::now() +
                                                        std::chrono::milliseconds(20));
      EXPECT_EQ(server.met(), speech.is_permitted) << "gRPC " << speech.name;
    }
    {
      OneServer server(speech, own_, use);
      checks::ServerKeys keys;
      keys.endpoint = server.endpoint();
      keys.tls_ca = authority_file_;
      const auto inputs = checks::probe_server(keys, "peer", std::chrono::seconds(10));
      EXPECT_EQ(server.met(), speech.is_permitted) << "doctor " << speech.name;
      EXPECT_EQ(inputs.tls, speech.is_permitted) << speech.name;
      EXPECT_FALSE(inputs.wants_certificate) << speech.name << ": it has not asked for one";
    }
  }
}

}  // namespace
}  // namespace ledgerline::crypto
