#include <arpa/inet.h>
#include <grpc/grpc_security_constants.h>
#include <grpcpp/server_context.h>

#include <algorithm>
#include <set>
#include <sstream>

#include "chaincode/shim/session.hpp"
#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tls/tls_server.hpp"
#include "peer/chaincode_shim.grpc.pb.h"

namespace ledgerline::shim {
namespace {

constexpr int max_message_bytes = 100 * 1024 * 1024;  // as Fabric's own shims

bool is_of_this_host_alone(const std::string& address) {
  std::string host = address.substr(0, address.rfind(':'));
  if (host.size() > 2 && host.front() == '[') host = host.substr(1, host.size() - 2);
  in_addr v4{};
  in6_addr v6{};
  if (::inet_pton(AF_INET, host.c_str(), &v4) == 1) return (ntohl(v4.s_addr) >> 24) == IN_LOOPBACKNET;
  return host == "localhost" || (::inet_pton(AF_INET6, host.c_str(), &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6));
}

/// What the options name; without files of TLS, which they may leave out together, nothing of it is there.
Result<fabric::TlsEndpoint> endpoint_of(const Options& options) {
  fabric::TlsEndpoint at{.name = "chaincode",
                         .listen = options.address,
                         .key_pem = "",
                         .certificate_pem = "",
                         .max_request_bytes = max_message_bytes,
                         .keepalive_ms = 60'000};
  if (options.key_file.empty() && options.certificate_file.empty()) {
    if (!options.client_ca_file.empty()) return Error{"a client CA without key and certificate: give all three"};
    if (!is_of_this_host_alone(options.address))
      return Error{options.address +
                   " is reached from other hosts, so it is served with TLS alone: set CHAINCODE_TLS_KEY and "
                   "CHAINCODE_TLS_CERT, or listen at 127.0.0.1"};
    return at;
  }
  auto key = crypto::read_key_file(options.key_file);
  if (!key) return key.error();
  auto certificate = read_file(options.certificate_file);
  if (!certificate) return certificate.error();
  at.key_pem = std::move(*key);
  at.certificate_pem = std::move(*certificate);
  if (options.client_ca_file.empty()) return at;
  auto authorities = fabric::read_client_authorities({options.client_ca_file});
  if (!authorities) return authorities.error();
  at.client_authorities_pem = std::move(*authorities);
  return at;
}

/// What a client's certificate says it is called.
std::set<std::string> names_of(const grpc::ServerContext& context) {
  std::set<std::string> names;
  const auto reported = context.auth_context();
  if (!reported) return names;
  for (const char* property : {GRPC_X509_CN_PROPERTY_NAME, GRPC_X509_SAN_PROPERTY_NAME}) {
    for (const grpc::string_ref& name : reported->FindPropertyValues(property)) names.emplace(name.data(), name.size());
  }
  return names;
}

class Service final : public protos::Chaincode::Service {
 public:
  Service(const Options& options, Invoke invoke)
      : id_(options.chaincode_id),
        client_names_(options.client_names.begin(), options.client_names.end()),
        invoke_(std::move(invoke)),
        workers_("contract", options.threads) {}

  grpc::Status Connect(grpc::ServerContext* context,
                       grpc::ServerReaderWriter<protos::ChaincodeMessage, protos::ChaincodeMessage>* stream) override {
    if (!is_allowed(*context)) {
      spdlog::warn("peer {}: its certificate has none of the names in CHAINCODE_TLS_CLIENT_NAMES", context->peer());
      return {grpc::StatusCode::PERMISSION_DENIED, "this chaincode service does not take this certificate"};
    }
    spdlog::info("peer {} connected", context->peer());
    // Transactions outlive the stream: after its end nothing is written to it any more.
    struct Writer {
      std::mutex mutex;
      decltype(stream) to;
    };
    const auto writer = std::make_shared<Writer>();
    writer->to = stream;
    const auto session = std::make_shared<Session>(
        id_, invoke_,
        [writer](const protos::ChaincodeMessage& message) {
          const std::lock_guard lock(writer->mutex);
          return writer->to != nullptr && writer->to->Write(message);
        },
        workers_);
    session->begin();
    grpc::Status end = grpc::Status::OK;
    for (protos::ChaincodeMessage message; stream->Read(&message);) {
      if (Status status = session->on_message(std::move(message)); !status) {
        spdlog::warn("peer {}: {}", context->peer(), status.error().message);
        end = {grpc::StatusCode::INVALID_ARGUMENT, status.error().message};
        break;
      }
    }
    session->end();
    {
      const std::lock_guard lock(writer->mutex);
      writer->to = nullptr;
    }
    spdlog::info("peer {} is gone", context->peer());
    return end;
  }

 private:
  bool is_allowed(const grpc::ServerContext& context) const {
    const std::set<std::string> names = names_of(context);
    return client_names_.empty() || std::any_of(names.begin(), names.end(),
                                                [&](const std::string& name) { return client_names_.contains(name); });
  }

  const std::string id_;
  const std::set<std::string> client_names_;
  const Invoke invoke_;
  Workers workers_;
};

class GrpcServer final : public Server {
 public:
  GrpcServer(const Options& options, Invoke invoke) : service_(options, std::move(invoke)) {}
  ~GrpcServer() override { GrpcServer::stop(); }

  Status listen(const Options& options) {
    const auto at = endpoint_of(options);
    if (!at) return at.error();
    auto served = options.key_file.empty() ? fabric::serve_in_plain_text(*at, {&service_})
                                           : fabric::serve_by_tls(*at, {&service_});
    if (!served) return served.error();
    served_ = std::move(*served);
    return done;
  }

  const std::string& endpoint() const override { return served_.endpoint; }
  void stop() override { served_.stop(); }

 private:
  Service service_;
  fabric::TlsServer served_;
};

}  // namespace

Result<Options> options_from_environment() {
  Options options;
  options.chaincode_id = environment_variable("CHAINCODE_ID");
  options.address = environment_variable("CHAINCODE_SERVER_ADDRESS");
  options.key_file = environment_variable("CHAINCODE_TLS_KEY");
  options.certificate_file = environment_variable("CHAINCODE_TLS_CERT");
  options.client_ca_file = environment_variable("CHAINCODE_TLS_CLIENT_CA");
  std::stringstream names(environment_variable("CHAINCODE_TLS_CLIENT_NAMES"));
  for (std::string name; std::getline(names, name, ',');) {
    if (!name.empty()) options.client_names.push_back(name);
  }
  if (!options.client_names.empty() && options.client_ca_file.empty())
    return Error{"CHAINCODE_TLS_CLIENT_NAMES needs CHAINCODE_TLS_CLIENT_CA: without it nobody shows a certificate"};
  if (options.chaincode_id.empty()) return Error{"CHAINCODE_ID is not set: the package id, LABEL:HASH"};
  if (options.address.empty()) return Error{"CHAINCODE_SERVER_ADDRESS is not set: where to listen, ADDRESS:PORT"};
  if (options.key_file.empty() != options.certificate_file.empty()) {
    return Error{"CHAINCODE_TLS_KEY and CHAINCODE_TLS_CERT belong together: one of them is not set"};
  }
  return options;
}

Result<std::string> package_id_from(std::string text) {
  if (text.ends_with('\n')) text.pop_back();
  const std::string_view all = text;
  const std::size_t colon = all.find(':');
  const std::string_view label = all.substr(0, colon), hash = colon == all.npos ? "" : all.substr(colon + 1);
  constexpr std::size_t sha256_digits = 64;
  const auto is_label_char = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '.' || c == '+' || c == '-';
  };
  const auto is_hex = [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); };
  if (!label.empty() && std::ranges::all_of(label, is_label_char) && hash.size() == sha256_digits &&
      std::ranges::all_of(hash, is_hex))
    return text;
  constexpr std::size_t max_shown = 128;
  return Error{"CHAINCODE_ID is \"" + printable(text, max_shown) +
               "\", and must be the package id, label:64 hex digits, without quotes, blanks or line breaks: no peer "
               "finds its chaincode under another"};
}

Result<std::unique_ptr<Server>> Server::start(const Options& options, Invoke invoke) {
  auto server = std::make_unique<GrpcServer>(options, std::move(invoke));
  if (Status status = server->listen(options); !status) return status.error();
  return std::unique_ptr<Server>(std::move(server));
}

}  // namespace ledgerline::shim
