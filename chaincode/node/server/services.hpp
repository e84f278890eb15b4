#pragma once
#include <memory>

#include "chaincode/node/shell/node.hpp"

namespace grpc {
class Service;
class Server;
}  // namespace grpc

namespace ledgerline::node {

/// The gRPC services: Fabric's gateway, endorser, deliver and ordering, each a thin translation to the core.
std::unique_ptr<grpc::Service> make_gateway_service(Node& node);
/// `peer`: the organisation, from 0, whose peer endorses here.
std::unique_ptr<grpc::Service> make_endorser_service(Node& node, std::size_t peer);
/// `mutual_tls`: clients have shown a certificate of TLS, and Deliver takes requests alone that name it.
std::unique_ptr<grpc::Service> make_deliver_service(Node& node, bool mutual_tls);
std::unique_ptr<grpc::Service> make_orderer_service(Node& node, bool mutual_tls);

/// All of them behind one TLS endpoint, with the certificate of Org1's peer. Those of the other organisations have
/// endpoints of their own, with endorser and deliver alone: for who asks peers for their endorsement.
class Server {
 public:
  /// `listen`: of the first, "127.0.0.1:7051"; port 0 takes a free one, as the others do. `client_authorities`: PEM,
  /// whose certificates clients must show at each endpoint; empty: they need none.
  static Result<std::unique_ptr<Server>> start(Node& node, const std::string& listen,
                                               std::string client_authorities = {});
  ~Server();
  const std::string& endpoint() const { return endpoints_.front(); }
  const std::vector<std::string>& endpoints() const { return endpoints_; }
  /// Ends all streams; returns when no call is left. To be destroyed only after Node::stop(): tasks of calls that have
  /// ended may wait there.
  void stop();

 private:
  explicit Server(std::string client_authorities);
  Status serve(Node& node, std::size_t peer, const std::string& address, const std::string& port);
  const std::string client_authorities_;
  std::vector<std::unique_ptr<grpc::Service>> services_;
  std::vector<std::unique_ptr<grpc::Server>> servers_;
  std::vector<std::string> endpoints_;
};

}  // namespace ledgerline::node
