#include "common/fabric/tls/tls_server.hpp"

#include <fmt/format.h>
#include <grpcpp/resource_quota.h>
#include <grpcpp/server_builder.h>

#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tls/grpc_locks.hpp"

namespace ledgerline::fabric {
namespace {

constexpr int keepalive_timeout_ms = 20'000;

Result<TlsServer> serve(const TlsEndpoint& at, const std::shared_ptr<grpc::ServerCredentials>& credentials,
                        const std::vector<grpc::Service*>& services) {
  if (Status s = check_endpoint(at.listen, 0); !s) return Error{"cannot listen on " + s.error().message};
  take_locks_at_once();
  grpc::ServerBuilder builder;
  int port = 0;
  builder.AddListeningPort(at.listen, credentials, &port);
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);  // two on one port would share its calls in silence
  builder.AddChannelArgument(GRPC_ARG_HTTP2_BDP_PROBE, 0);  // its pings would answer each message
  builder.SetMaxReceiveMessageSize(at.max_request_bytes);
  builder.SetMaxSendMessageSize(-1);
  if (at.max_memory_bytes > 0) builder.SetResourceQuota(grpc::ResourceQuota(at.name).Resize(at.max_memory_bytes));
  // Clients may ask every 20 s whether we are there, also while nothing happens.
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 20'000);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  if (at.keepalive_ms > 0) {
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, at.keepalive_ms);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, keepalive_timeout_ms);
  }
  for (grpc::Service* service : services) builder.RegisterService(service);
  auto server = builder.BuildAndStart();
  if (!server || port == 0) return Error{"cannot listen on " + at.listen + ": ADDRESS:PORT, and is it free?"};
  return TlsServer{std::move(server), at.listen.substr(0, at.listen.rfind(':') + 1) + std::to_string(port)};
}

}  // namespace

Result<std::string> read_client_authorities(const std::vector<std::string>& files) {
  std::string all;
  for (const std::string& file : files) {
    const auto pem = crypto::read_certificate_file(file);
    if (!pem) return pem.error();
    all += *pem + "\n";
  }
  return all;
}

/// Versions and ciphers: common/crypto/tls_policy.hpp.
Result<TlsServer> serve_by_tls(const TlsEndpoint& at, const std::vector<grpc::Service*>& services) {
  grpc::SslServerCredentialsOptions tls(at.client_authorities_pem.empty()
                                            ? GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE
                                            : GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  // gRPC would say of a pair that does not fit that it cannot listen.
  const auto own = crypto::own_first(at.key_pem, at.certificate_pem);
  if (!own) return Error{fmt::format("{}: TLS key and certificate: {}", at.listen, own.error().message)};
  tls.pem_key_cert_pairs.push_back({at.key_pem, *own});
  tls.pem_root_certs = at.client_authorities_pem;
  return serve(at, grpc::SslServerCredentials(tls), services);
}

Result<TlsServer> serve_in_plain_text(const TlsEndpoint& at, const std::vector<grpc::Service*>& services) {
  return serve(at, grpc::InsecureServerCredentials(), services);
}

}  // namespace ledgerline::fabric
