#include "tools/checks/shell/probes.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netdb.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <memory>

#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/crypto/openssl.hpp"
#include "common/crypto/tls_policy.hpp"

namespace ledgerline::checks {
namespace {

using ContextPtr = std::unique_ptr<SSL_CTX, crypto::Freed<SSL_CTX_free>>;
using SslPtr = std::unique_ptr<SSL, crypto::Freed<SSL_free>>;
using AddressesPtr = std::unique_ptr<addrinfo, crypto::Freed<freeaddrinfo>>;

class Socket {
 public:
  explicit Socket(int fd) : fd_(fd) {}
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  ~Socket() {
    if (fd_ >= 0) ::close(fd_);
  }
  int fd() const { return fd_; }

 private:
  int fd_;
};

std::pair<std::string, std::string> host_and_port(const std::string& endpoint) {
  const std::size_t colon = endpoint.rfind(':');
  if (colon == std::string::npos) return {endpoint, ""};
  std::string host = endpoint.substr(0, colon);
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  return {host, endpoint.substr(colon + 1)};
}

bool ready(int fd, short events, std::chrono::milliseconds timeout) {
  pollfd one{fd, events, 0};
  return ::poll(&one, 1, static_cast<int>(timeout.count())) == 1;
}

ServerInputs::Reached reached_by(int error) {
  using Reached = ServerInputs::Reached;
  if (error == 0) return Reached::yes;
  if (error == ECONNREFUSED) return Reached::closed;
  return error == ETIMEDOUT ? Reached::silent : Reached::no_route;
}

/// 0: connected; else errno.
int connect_within(int fd, const addrinfo& to, std::chrono::milliseconds timeout) {
  if (::connect(fd, to.ai_addr, to.ai_addrlen) == 0) return 0;
  if (errno != EINPROGRESS) return errno;
  if (!ready(fd, POLLOUT, timeout)) return ETIMEDOUT;
  int error = 0;
  socklen_t size = sizeof error;
  return ::getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size) == 0 ? error : errno;
}

/// Notes each thing that is wrong with the chain and goes on.
int note_problem(int good, X509_STORE_CTX* context) {
  if (good == 1) return 1;
  const SSL* ssl = static_cast<const SSL*>(X509_STORE_CTX_get_ex_data(context, SSL_get_ex_data_X509_STORE_CTX_idx()));
  auto& inputs = *static_cast<ServerInputs*>(SSL_get_app_data(ssl));
  switch (X509_STORE_CTX_get_error(context)) {
    case X509_V_ERR_CERT_HAS_EXPIRED:
      inputs.expired = true;
      break;
    case X509_V_ERR_CERT_NOT_YET_VALID:
      inputs.not_yet = true;
      break;
    case X509_V_ERR_HOSTNAME_MISMATCH:
    case X509_V_ERR_IP_ADDRESS_MISMATCH:
      inputs.right_name = false;
      break;
    default:
      inputs.trusted = false;
  }
  return 1;
}

void read_certificate(const SSL* ssl, ServerInputs& inputs) {
  X509* const certificate = SSL_get0_peer_certificate(ssl);
  if (!certificate) return;
  char text[256] = {};
  X509_NAME_oneline(X509_get_issuer_name(certificate), text, sizeof text);
  inputs.issuer = printable(text);
  auto* names = static_cast<GENERAL_NAMES*>(X509_get_ext_d2i(certificate, NID_subject_alt_name, nullptr, nullptr));
  for (int i = 0; i < sk_GENERAL_NAME_num(names); ++i) {
    const GENERAL_NAME* one = sk_GENERAL_NAME_value(names, i);
    std::string name;
    if (one->type == GEN_DNS) {
      name.assign(reinterpret_cast<const char*>(ASN1_STRING_get0_data(one->d.dNSName)),
                  static_cast<std::size_t>(ASN1_STRING_length(one->d.dNSName)));
    } else if (one->type == GEN_IPADD && ASN1_STRING_length(one->d.iPAddress) == 4) {
      ::inet_ntop(AF_INET, ASN1_STRING_get0_data(one->d.iPAddress), text, sizeof text);
      name = text;
    }
    if (!name.empty()) inputs.names += (inputs.names.empty() ? "" : ", ") + printable(name);
  }
  GENERAL_NAMES_free(names);
}

/// Goes on with what OpenSSL waits for; false: it failed, or nothing came in time, which `mute` says.
template <typename Step>
bool complete(SSL* ssl, int fd, std::chrono::milliseconds timeout, bool& mute, Step step) {
  for (;;) {
    const int result = step();
    if (result > 0) return true;
    const int why = SSL_get_error(ssl, result);
    if (why != SSL_ERROR_WANT_READ && why != SSL_ERROR_WANT_WRITE) return false;
    mute = !ready(fd, why == SSL_ERROR_WANT_READ ? POLLIN : POLLOUT, timeout);
    if (mute) return false;
  }
}

/// The connection is over: what that says of a certificate of ours. Go's servers report by an alert that there must be
/// one, or that the one shown does not do; gRPC's own close the connection without a word behind the handshake, where
/// they had `asked` for one.
void read_end(bool asked, bool shown, ServerInputs& inputs) {
  constexpr std::array of_certificates{
      SSL_R_TLSV13_ALERT_CERTIFICATE_REQUIRED, SSL_R_SSLV3_ALERT_HANDSHAKE_FAILURE,
      SSL_R_SSLV3_ALERT_BAD_CERTIFICATE,       SSL_R_SSLV3_ALERT_UNSUPPORTED_CERTIFICATE,
      SSL_R_SSLV3_ALERT_CERTIFICATE_REVOKED,   SSL_R_SSLV3_ALERT_CERTIFICATE_EXPIRED,
      SSL_R_SSLV3_ALERT_CERTIFICATE_UNKNOWN,   SSL_R_TLSV1_ALERT_UNKNOWN_CA};
  for (unsigned long code = 0; (code = ERR_get_error()) != 0;) {
    const int reason = ERR_GET_REASON(code);
    if (std::find(of_certificates.begin(), of_certificates.end(), reason) == of_certificates.end()) continue;
    // Also said where the two have no version or cipher in common, before any certificate is asked for.
    if (reason == SSL_R_SSLV3_ALERT_HANDSHAKE_FAILURE && !asked) continue;
    const char* const words = ERR_reason_error_string(code);
    if (shown) inputs.refuses_certificate = words ? words : "an alert";
    inputs.wants_certificate = !shown;
  }
  if (!asked || inputs.mute || inputs.wants_certificate) return;
  inputs.wants_certificate = !shown;
  if (shown && inputs.refuses_certificate.empty())
    inputs.refuses_certificate = "it closes the connection when it has seen the certificate";
}

// The preface of HTTP/2 (RFC 9113, 3.4): 24 bytes, and empty SETTINGS.
constexpr char hello[] = "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\4\0\0\0\0\0";

void shake_hands(SSL_CTX* context, int fd, std::chrono::milliseconds timeout, ServerInputs& inputs) {
  const bool shown = SSL_CTX_get0_certificate(context) != nullptr;
  const SslPtr ssl(SSL_new(context));
  if (!ssl) return;
  SSL_set_app_data(ssl.get(), &inputs);
  SSL_set_verify(ssl.get(), SSL_VERIFY_PEER, note_problem);
  X509_VERIFY_PARAM* const param = SSL_get0_param(ssl.get());
  if (X509_VERIFY_PARAM_set1_ip_asc(param, inputs.name.c_str()) != 1) {
    X509_VERIFY_PARAM_set1_host(param, inputs.name.c_str(), inputs.name.size());
    SSL_set_tlsext_host_name(ssl.get(), inputs.name.c_str());
  }
  constexpr unsigned char h2[] = {2, 'h', '2'};
  SSL_set_alpn_protos(ssl.get(), h2, sizeof h2);
  bool asked = false;
  SSL_set_cert_cb(
      ssl.get(), [](SSL*, void* is_asked) { return *static_cast<bool*>(is_asked) = true, 1; }, &asked);
  SSL_set_fd(ssl.get(), fd);
  inputs.trusted = inputs.right_name = true;
  ERR_clear_error();
  if (!complete(ssl.get(), fd, timeout, inputs.mute, [&] { return SSL_connect(ssl.get()); })) {
    read_end(asked, shown, inputs);
    return;
  }
  inputs.tls = true;
  read_certificate(ssl.get(), inputs);
  const unsigned char* protocol = nullptr;
  unsigned size = 0;
  SSL_get0_alpn_selected(ssl.get(), &protocol, &size);
  inputs.http2 = size == 2 && std::memcmp(protocol, "h2", 2) == 0;
  char answer[64];
  ERR_clear_error();
  // A server that refuses has its alert on the way when it closes the connection, so it is read even where nothing can
  // be written any more.
  (void)complete(ssl.get(), fd, timeout, inputs.mute, [&] { return SSL_write(ssl.get(), hello, sizeof hello - 1); });
  if (!complete(ssl.get(), fd, timeout, inputs.mute, [&] { return SSL_read(ssl.get(), answer, sizeof answer); }))
    read_end(asked, shown, inputs);
}

/// With the authorities of `keys`, and its own pair, where it has them.
ContextPtr context_for(const ServerKeys& keys, ServerInputs& inputs) {
  ContextPtr context(SSL_CTX_new(TLS_client_method()));
  if (!context) return context;
  crypto::apply_tls_policy(context.get());
  if (!keys.tls_ca.empty() && SSL_CTX_load_verify_locations(context.get(), keys.tls_ca.c_str(), nullptr) != 1) {
    const auto bytes = read_file(keys.tls_ca);
    inputs.no_authority = fmt::format("{}: {}", keys.tls_ca, bytes ? "no certificate in PEM" : "it cannot be read");
    if (is_forbidden(keys.tls_ca)) {
      inputs.authority_problem = Problem::file_forbidden;
      inputs.authority_cure = cure_of_forbidden(keys.tls_ca);
    } else if (bytes && is_der(*bytes)) {
      inputs.authority_problem = Problem::not_pem;
      inputs.authority_cure = cure_of_der(keys.tls_ca);
    }
  }
  X509_VERIFY_PARAM_set_flags(SSL_CTX_get0_param(context.get()), X509_V_FLAG_PARTIAL_CHAIN);
  if (!keys.tls_certificate.empty() &&
      (SSL_CTX_use_certificate_chain_file(context.get(), keys.tls_certificate.c_str()) != 1 ||
       SSL_CTX_use_PrivateKey_file(context.get(), keys.tls_key.c_str(), SSL_FILETYPE_PEM) != 1))
    inputs.no_pair = fmt::format("{} and {}", keys.tls_certificate, keys.tls_key);
  ERR_clear_error();
  return context;
}

}  // namespace

ServerInputs probe_server(const ServerKeys& keys, const std::string& what, std::chrono::milliseconds timeout) {
  using Reached = ServerInputs::Reached;
  ServerInputs inputs{.what = what, .endpoint = keys.endpoint, .name = keys.server_name, .tls_ca = keys.tls_ca};
  if (!is_endpoint(keys.endpoint)) {
    inputs.reached = Reached::malformed;
    return inputs;
  }
  const auto [host, port] = host_and_port(keys.endpoint);
  if (inputs.name.empty()) inputs.name = host;
  addrinfo hints{}, *list = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  const int unknown = ::getaddrinfo(host.c_str(), port.c_str(), &hints, &list);
  if (unknown != 0) {
    inputs.reached = Reached::name_unknown;
    inputs.why = ::gai_strerror(unknown);
    return inputs;
  }
  const AddressesPtr addresses(list);
  // As programs do, which go on to the next where one address of a name does not answer.
  for (const addrinfo* one = addresses.get(); one; one = one->ai_next) {
    const Socket socket(::socket(one->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    const int error = socket.fd() < 0 ? errno : connect_within(socket.fd(), *one, timeout);
    inputs.reached = reached_by(error);
    inputs.why = error == 0 ? "" : std::strerror(error);
    if (error != 0) continue;
    const ContextPtr context = context_for(keys, inputs);
    if (context && inputs.no_authority.empty() && inputs.no_pair.empty())
      shake_hands(context.get(), socket.fd(), timeout, inputs);
    return inputs;
  }
  return inputs;
}

}  // namespace ledgerline::checks
