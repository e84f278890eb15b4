#pragma once
#include <grpcpp/impl/service_type.h>
#include <grpcpp/server.h>

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline::fabric {

struct TlsEndpoint {
  std::string name;                      ///< of the memory's quota
  std::string listen;                    ///< ADDRESS:PORT; port 0: a free one
  std::string key_pem, certificate_pem;  ///< clients need none: who asks is known by the signature on each request
  int max_request_bytes = 0;
  std::size_t max_memory_bytes = 0;  ///< of all requests that are being received
};

struct TlsServer {
  std::unique_ptr<grpc::Server> server;
  std::string endpoint;  ///< ADDRESS:PORT
};
/// Starts a server for clients of Fabric. An error: the address cannot be had. The services must outlive it.
Result<TlsServer> serve_by_tls(const TlsEndpoint& at, const std::vector<grpc::Service*>& services);

}  // namespace ledgerline::fabric
