#pragma once
#include <grpcpp/impl/service_type.h>
#include <grpcpp/server.h>

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline::fabric {

struct TlsEndpoint {
  std::string name;    ///< of the memory's quota
  std::string listen;  ///< ADDRESS:PORT; port 0: a free one
  std::string key_pem, certificate_pem;
  /// Clients must show a certificate that one of these has signed. Empty: they need none, since who asks is known by
  /// the signature on each request.
  std::string client_authorities_pem{};
  int max_request_bytes = 0;
  std::size_t max_memory_bytes = 0;  ///< of all requests that are being received; 0: as many as come
  /// Asked of a client after so long without a byte of it, whose end no packet has said: 0: never asked.
  int keepalive_ms = 0;
};

/// PEM files of authorities, as client_authorities_pem; none: none. An error names the file.
Result<std::string> read_client_authorities(const std::vector<std::string>& files);

struct TlsServer {
  std::unique_ptr<grpc::Server> server;
  std::string endpoint;  ///< ADDRESS:PORT
  /// Open calls get 0.2 s; returns when none is left.
  void stop() {
    if (!server) return;
    server->Shutdown(std::chrono::system_clock::now() + std::chrono::milliseconds(200));
    server->Wait();
    server.reset();
  }
};
/// Starts a server for clients of Fabric. An error: the address cannot be had. The services must outlive it.
Result<TlsServer> serve_by_tls(const TlsEndpoint& at, const std::vector<grpc::Service*>& services);
/// The same without TLS: for an address that other hosts do not reach.
Result<TlsServer> serve_in_plain_text(const TlsEndpoint& at, const std::vector<grpc::Service*>& services);

}  // namespace ledgerline::fabric
