#include "common/web/tls.hpp"

#include <fmt/format.h>
#include <openssl/crypto.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <boost/asio/ssl/error.hpp>

#include "common/base/file.hpp"
#include "common/crypto/tls_policy.hpp"
#include "common/rt/clock.hpp"
#include "common/web/host_port.hpp"

namespace ledgerline::web {
namespace {

namespace ssl = boost::asio::ssl;

constexpr int max_chain = 4;  // certificates between the other side's and its authority

/// The newest error of this thread's queue, which is then empty: any other TLS code of this thread reads that queue,
/// too.
std::string openssl_error() {
  const char* words = ERR_reason_error_string(ERR_peek_last_error());
  ERR_clear_error();
  return words ? words : "OpenSSL does not say why";
}

TlsContext context_of(ssl::context::method method) {
  auto context = std::make_shared<ssl::context>(method);
  crypto::apply_tls_policy(context->native_handle());
  SSL_CTX_set_verify_depth(context->native_handle(), max_chain);
  return context;
}

/// `pair` as it was read from `files`.
Status use_own(ssl::context& context, const TlsFiles& files, const crypto::Renewal::Pair& pair) {
  boost::system::error_code error;
  context.use_certificate_chain(boost::asio::buffer(pair.certificate_pem), error);
  if (error) return Error{fmt::format("{} has no certificate in PEM: {}", files.certificate, openssl_error())};
  context.use_private_key(boost::asio::buffer(pair.key_pem), ssl::context::pem, error);
  if (error)
    return Error{fmt::format("{} is no private key in PEM without a pass phrase, or not that of {}: {}", files.key,
                             files.certificate, openssl_error())};
  if (SSL_CTX_check_private_key(context.native_handle()) != 1)
    return Error{fmt::format("{} is not the key of {}: {}", files.key, files.certificate, openssl_error())};
  return done;
}

/// As the files are now. The certificate of the pair; its key is wiped.
Result<crypto::Renewal::Pair> load_own(ssl::context& context, const TlsFiles& files) {
  auto pair = crypto::read_pair({files.certificate, files.key});
  if (!pair) return pair;
  const Status used = use_own(context, files, *pair);
  OPENSSL_cleanse(pair->key_pem.data(), pair->key_pem.size());
  pair->key_pem.clear();
  if (!used) return used.error();
  return pair;
}

Status trust(ssl::context& context, const std::string& file) {
  const auto authorities = read_file(file);
  if (!authorities) return authorities.error();
  boost::system::error_code error;
  context.add_certificate_authority(boost::asio::buffer(*authorities), error);
  if (error) return Error{fmt::format("{} has no certificate in PEM: {}", file, openssl_error())};
  return done;
}

/// Of a server, as the files are now; the rest of it is `made`.
Result<crypto::Renewal::Pair> load_server(const TlsFiles& files, TlsContext& made) {
  made = context_of(ssl::context::tls_server);
  auto own = load_own(*made, files);
  if (!own || files.authority.empty()) return own;
  if (auto status = trust(*made, files.authority); !status) return status.error();
  // Sent to clients, so that a browser offers the right one.
  auto* const reported = SSL_load_client_CA_file(files.authority.c_str());
  if (!reported) return Error{fmt::format("{} has no certificate in PEM: {}", files.authority, openssl_error())};
  SSL_CTX_set_client_CA_list(made->native_handle(), reported);
  made->set_verify_mode(ssl::verify_peer | ssl::verify_fail_if_no_peer_cert);
  return own;
}

std::vector<std::string> names_of(const TlsFiles& files) { return {files.certificate, files.key, files.authority}; }

}  // namespace

Result<TlsContext> server_tls(const TlsFiles& files) {
  TlsContext made;
  const auto own = load_server(files, made);
  if (!own) return own.error();
  return made;
}

Result<TlsContext> client_tls(const TlsFiles& files) {
  TlsContext context = context_of(ssl::context::tls_client);
  context->set_verify_mode(ssl::verify_peer);
  if (files.authority.empty()) {
    SSL_CTX_set_default_verify_paths(context->native_handle());
  } else {
    if (auto status = trust(*context, files.authority); !status) return status.error();
    X509_VERIFY_PARAM_set_flags(SSL_CTX_get0_param(context->native_handle()), X509_V_FLAG_PARTIAL_CHAIN);
  }
  if (files.certificate.empty()) return context;
  if (const auto own = load_own(*context, files); !own) return own.error();
  return context;
}

void expect_host(SSL* connection, const std::string& host) {
  if (host_kind(host) == HostKind::name) {
    SSL_set_tlsext_host_name(connection, host.c_str());
    SSL_set_hostflags(connection, X509_CHECK_FLAG_NO_PARTIAL_WILDCARDS);
    SSL_set1_host(connection, host.c_str());
  } else {
    X509_VERIFY_PARAM_set1_ip_asc(SSL_get0_param(connection), host.c_str());
  }
}

std::string certificate_fault(SSL* connection) {
  const long fault = SSL_get_verify_result(connection);
  return fault == X509_V_OK ? "" : X509_verify_cert_error_string(fault);
}

bool is_plain_http(const boost::system::error_code& error) {
  return error.category() == boost::asio::error::get_ssl_category() &&
         ERR_GET_REASON(static_cast<unsigned long>(error.value())) == SSL_R_HTTP_REQUEST;
}

Result<RenewedTls> RenewedTls::open(TlsFiles files) {
  crypto::Renewal renewal("the page", "", 0);
  renewal.ignore_present(names_of(files));  // before they are read: what changes meanwhile is seen at the next look
  TlsContext context;
  const auto own = load_server(files, context);
  if (!own) return own.error();
  renewal.begin(*own);
  return RenewedTls(std::move(files), std::move(context), std::move(renewal));
}

std::optional<Status> RenewedTls::renew() {
  TlsContext next;
  const auto found =
      renewal_.check_files(names_of(files_), realtime_ns() / ns_per_s, [&] { return load_server(files_, next); });
  if (!found) return std::nullopt;
  if (!*found) return found->error();
  context_ = std::move(next);
  return done;
}

std::int64_t RenewedTls::seconds_left() const { return renewal_.not_after_s() - realtime_ns() / ns_per_s; }

}  // namespace ledgerline::web
