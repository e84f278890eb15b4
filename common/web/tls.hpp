#pragma once
#include <boost/asio/ssl/context.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/files/changed_files.hpp"
#include "common/base/result.hpp"
#include "common/web/tls_files.hpp"

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
  /// Looks whether the files have changed: three calls of stat where not. New ones are read when they stay the same
  /// from one look to the next, since certificate and key are two files. nullopt: no news; done: taken; an error: why
  /// not, said once, and the old ones stay.
  std::optional<Status> look();
  /// Whole days that its certificate is valid for; below 0: it has run out.
  int days_left() const;

 private:
  explicit RenewedTls(TlsFiles files) : files_(std::move(files)) {}
  std::vector<std::string> names() const { return {files_.certificate, files_.key, files_.authority}; }

  TlsFiles files_;
  TlsContext context_;
  ChangedFiles changes_;
};

}  // namespace ledgerline::web
