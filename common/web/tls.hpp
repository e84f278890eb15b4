#pragma once
#include <boost/asio/ssl/context.hpp>
#include <memory>
#include <optional>
#include <string>

#include "common/base/result.hpp"
#include "common/crypto/identities/renewal.hpp"
#include "common/web/host_port.hpp"

/// TLS from files, by OpenSSL, as crypto/tls_policy.hpp says.
namespace ledgerline::web {

using TlsContext = std::shared_ptr<boost::asio::ssl::context>;

/// Of a server. With an authority nobody gets past the handshake without a certificate of it. An error names the file.
Result<TlsContext> server_tls(const TlsFiles& files);
/// Of a client. Without an authority the system's are trusted; one that is named is trusted alone, and may be the
/// server's own certificate.
Result<TlsContext> client_tls(const TlsFiles& files);

/// Before the handshake: the server must be that host, by name or by address.
void expect_host(SSL* connection, const std::string& host);
/// Why a handshake has failed, of the other side's certificate; empty: not by that.
std::string certificate_fault(SSL* connection);

/// Whether a server's handshake has failed since the other side speaks HTTP without TLS.
bool is_plain_http(const boost::system::error_code& error);

/// A server's TLS, which takes renewed files without a restart. What is connected goes on with what it has. One thread.
class RenewedTls {
 public:
  static Result<RenewedTls> open(TlsFiles files);

  boost::asio::ssl::context& context() { return *context_; }
  /// Looks whether the files have changed (crypto::Renewal). nullopt: no news; done: taken; an error: why not, said
  /// once, and the old ones stay.
  std::optional<Status> renew();
  /// That its certificate is valid for; below 0: it has run out.
  std::int64_t seconds_left() const;

 private:
  RenewedTls(TlsFiles files, TlsContext context, crypto::Renewal renewal)
      : files_(std::move(files)), context_(std::move(context)), renewal_(std::move(renewal)) {}

  TlsFiles files_;
  TlsContext context_;
  crypto::Renewal renewal_;
};

}  // namespace ledgerline::web
