#include "chaincode/endorser/shell/serving.hpp"

#include <chrono>
#include <utility>

#include "common/base/file.hpp"
#include "common/fabric/serving/tls_server.hpp"
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
    const node::Reply reply = service_.process_proposal(request->SerializeAsString());
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

class EndorserServer final : public Served {
 public:
  explicit EndorserServer(Service& service) : answers_(service) {}
  ~EndorserServer() override {
    if (!served_.server) return;
    served_.server->Shutdown(std::chrono::system_clock::now() + std::chrono::milliseconds(200));
    served_.server->Wait();
  }
  EndorserServer(const EndorserServer&) = delete;
  EndorserServer& operator=(const EndorserServer&) = delete;

  Status start(fabric::TlsEndpoint at) {
    auto served = fabric::serve_by_tls(at, {&answers_});
    if (!served) return served.error();
    served_ = std::move(*served);
    return done;
  }
  const std::string& endpoint() const override { return served_.endpoint; }

 private:
  EndorserService answers_;
  fabric::TlsServer served_;
};

}  // namespace

Result<std::unique_ptr<Served>> serve(Service& service, const ServeSettings& settings, const std::string& table) {
  auto certificate = read_file(settings.tls_certificate);
  if (!certificate) return Error{table + "tls_certificate: " + certificate.error().what};
  auto key = read_file(settings.tls_key);
  if (!key) return Error{table + "tls_key: " + key.error().what};
  auto server = std::make_unique<EndorserServer>(service);
  if (Status s = server->start({.name = "endorser",
                                .listen = settings.listen,
                                .key_pem = std::move(*key),
                                .certificate_pem = std::move(*certificate),
                                .max_request_bytes = max_request_bytes,
                                .max_memory_bytes = max_memory_bytes});
      !s)
    return s.error();
  return std::unique_ptr<Served>(std::move(server));
}

}  // namespace ledgerline::endorser
