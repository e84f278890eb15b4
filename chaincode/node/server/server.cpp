#include <google/protobuf/stubs/logging.h>
#include <grpc/support/log.h>
#include <grpcpp/impl/service_type.h>
#include <grpcpp/server.h>

#include <atomic>
#include <chrono>
#include <memory>

#include "chaincode/node/server/services.hpp"
#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/fabric/tls/tls_server.hpp"

namespace ledgerline::node {
namespace {

/// gRPC's own threads outlive main and its statics, and may log until the process is gone: never destroyed.
spdlog::logger& grpc_logger() {
  static const auto& logger = *new std::shared_ptr<spdlog::logger>(spdlog::default_logger());
  return *logger;
}

/// Unauthenticated clients cause most of gRPC's lines (each handshake that fails is one): at most one a second.
void log_seldom(gpr_log_func_args* line) {
  static std::atomic<TimeNs> next{0};
  static std::atomic<std::uint64_t> left_out{0};
  const TimeNs now = monotonic_ns();
  TimeNs due = next;
  if (now < due || !next.compare_exchange_strong(due, now + ns_per_s)) {
    ++left_out;
    return;
  }
  grpc_logger().warn("gRPC: {} ({} lines left out before)", printable(line->message), left_out.exchange(0));
}

}  // namespace

Result<std::unique_ptr<Server>> Server::start(Node& node, const std::string& listen, std::string client_authorities) {
  const auto colon = listen.rfind(':');
  if (colon == std::string::npos) return Error{"--listen " + listen + ": give ADDRESS:PORT"};
  grpc_logger();  // made here: a thread that outlives main must not be the first to ask
  gpr_set_log_function(log_seldom);
  // protobuf would write a line for each text of an unauthenticated client that is no UTF-8.
  google::protobuf::SetLogHandler(nullptr);
  std::unique_ptr<Server> server(new Server(std::move(client_authorities)));
  for (std::size_t peer = 0; peer < node.identities().peers.size(); ++peer) {
    const std::string port = peer == 0 ? listen.substr(colon + 1) : "0";
    if (Status status = server->serve(node, peer, listen.substr(0, colon + 1), port); !status) return status.error();
  }
  return server;
}

Status Server::serve(Node& node, std::size_t peer, const std::string& address, const std::string& port) {
  const std::size_t before = services_.size();
  const bool mutual_tls = !client_authorities_.empty();
  services_.push_back(make_endorser_service(node, peer));
  services_.push_back(make_deliver_service(node, mutual_tls));
  if (peer == 0) {
    services_.push_back(make_gateway_service(node));
    services_.push_back(make_orderer_service(node, mutual_tls));
  }

  const auto& own = node.identities().tls.at(peer);
  // One more byte than the largest transaction, with room for its frame, so that the orderer's own answer is heard.
  constexpr int room = 1 << 20;
  constexpr std::size_t max_memory_bytes = 512'000'000;
  std::vector<grpc::Service*> services;
  for (std::size_t i = before; i < services_.size(); ++i) services.push_back(services_[i].get());
  auto served = fabric::serve_by_tls({.name = "node",
                                      .listen = address + port,
                                      .key_pem = own.key_pem,
                                      .certificate_pem = own.certificate_pem,
                                      .client_authorities_pem = client_authorities_,
                                      .max_request_bytes = static_cast<int>(node.config().max_envelope_bytes) + room,
                                      .max_memory_bytes = max_memory_bytes},
                                     services);
  if (!served) return served.error();
  servers_.push_back(std::move(served->server));
  endpoints_.push_back(std::move(served->endpoint));
  return done;
}

Server::Server(std::string client_authorities) : client_authorities_(std::move(client_authorities)) {}
Server::~Server() { stop(); }

void Server::stop() {
  const auto until = std::chrono::system_clock::now() + std::chrono::milliseconds(200);
  for (const auto& server : servers_) server->Shutdown(until);
  for (const auto& server : servers_) server->Wait();
  servers_.clear();
}

}  // namespace ledgerline::node
