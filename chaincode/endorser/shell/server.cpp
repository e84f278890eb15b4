#include "chaincode/endorser/shell/service.hpp"

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <utility>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tls/tls_server.hpp"
#include "peer/peer.grpc.pb.h"

namespace ledgerline::endorser {
namespace {

constexpr int max_request_bytes = 11 << 20;            // Fabric's AbsoluteMaxBytes, with room for a frame
constexpr std::size_t max_memory_bytes = 256'000'000;  // of all requests that are being received

class EndorserService final : public protos::Endorser::CallbackService {
 public:
  explicit EndorserService(endorser::Service& service) : service_(service) {}

  grpc::ServerUnaryReactor* ProcessProposal(grpc::CallbackServerContext* context, const protos::SignedProposal* request,
                                            protos::ProposalResponse* response) override {
    grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
    const node::Reply reply = service_.process_proposal(request->SerializeAsString(), endorser::Service::Caller::other);
    if (reply.code != node::Code::ok) {
      const bool elsewhere = reply.code == node::Code::unavailable;
      reactor->Finish({elsewhere ? grpc::StatusCode::UNAVAILABLE : grpc::StatusCode::UNKNOWN, reply.message});
    } else {
      response->ParseFromString(reply.bytes);
      reactor->Finish(grpc::Status::OK);
    }
    return reactor;
  }

 private:
  endorser::Service& service_;
};

class GrpcServer final : public Server {
 public:
  GrpcServer(Service& service, std::string certificate_file, std::shared_ptr<const fabric::TlsPairsInUse> tls)
      : answers_(service), certificate_file_(std::move(certificate_file)), tls_(std::move(tls)) {}
  ~GrpcServer() override {
    renewing_ = {};
    served_.stop();
  }
  GrpcServer(const GrpcServer&) = delete;
  GrpcServer& operator=(const GrpcServer&) = delete;

  Status start(fabric::TlsEndpoint at) {
    at_ = std::move(at);
    auto served = fabric::serve_by_tls(at_, {&answers_});
    if (!served) return served.error();
    served_ = std::move(*served);
    at_.listen = endpoint_ = served_.endpoint;
    if (tls_) renewing_ = std::jthread([this](const std::stop_token& stop) { renew(stop); });
    return done;
  }
  const std::string& endpoint() const override { return endpoint_; }

 private:
  /// gRPC's server keeps the pair that it was made with.
  void renew(const std::stop_token& stop) {
    std::mutex mutex;
    std::condition_variable_any wake;
    std::string problem;
    while (!stop.stop_requested()) {
      {
        std::unique_lock lock(mutex);
        wake.wait_for(lock, stop, look_period, [] { return false; });
      }
      auto pair = tls_->of(certificate_file_);
      if (stop.stop_requested() || !pair || (served_.server && pair->certificate_pem == at_.certificate_pem)) continue;
      at_.certificate_pem = std::move(pair->certificate_pem);
      at_.key_pem = std::move(pair->key_pem);
      served_.stop();
      if (auto served = fabric::serve_by_tls(at_, {&answers_})) {
        served_ = std::move(*served);
        problem.clear();
        spdlog::info("endorser: serves at {} with its renewed TLS certificate", endpoint_);
      } else if (std::exchange(problem, served.error().message) != served.error().message) {
        spdlog::error("endorser: does not serve with its renewed TLS certificate, tried again each {} s: {}",
                      look_period.count(), problem);
      }
    }
  }

  static constexpr std::chrono::seconds look_period{1};  // as the watch of the files: twice as long is a later renewal

  EndorserService answers_;
  const std::string certificate_file_;
  const std::shared_ptr<const fabric::TlsPairsInUse> tls_;
  fabric::TlsEndpoint at_;
  std::string endpoint_;
  fabric::TlsServer served_;  ///< from start() on the thread's, until that has ended
  std::jthread renewing_;
};

}  // namespace

Result<std::unique_ptr<Server>> serve(Service& service, const ServeSettings& settings, const std::string& table,
                                      std::shared_ptr<const fabric::TlsPairsInUse> tls) {
  auto certificate = read_file(settings.tls_certificate);
  if (!certificate) return Error{table + "tls_certificate: " + certificate.error().message};
  auto key = crypto::read_key_file(settings.tls_key);
  if (!key) return Error{table + "tls_key: " + key.error().message};
  std::vector<std::string> authorities;
  if (!settings.tls_client_ca.empty()) authorities.push_back(settings.tls_client_ca);
  auto client_authorities = fabric::read_client_authorities(authorities);
  if (!client_authorities) return Error{table + "tls_client_ca: " + client_authorities.error().message};
  auto server = std::make_unique<GrpcServer>(service, settings.tls_certificate, std::move(tls));
  if (Status s = server->start({.name = "endorser",
                                .listen = settings.listen,
                                .key_pem = std::move(*key),
                                .certificate_pem = std::move(*certificate),
                                .client_authorities_pem = std::move(*client_authorities),
                                .max_request_bytes = max_request_bytes,
                                .max_memory_bytes = max_memory_bytes});
      !s)
    return s.error();
  return std::unique_ptr<Server>(std::move(server));
}

}  // namespace ledgerline::endorser
