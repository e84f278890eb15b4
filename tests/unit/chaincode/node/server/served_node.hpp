#pragma once
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "chaincode/node/server/services.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/rt/clock.hpp"
#include "msp/identities.pb.h"

namespace ledgerline::node {

inline std::string text_of(const std::filesystem::path& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  EXPECT_TRUE(in) << path;
  return text.str();
}

/// The node behind its TLS endpoint, on a free port, in this process, with a ledger of its own on disk.
class ServedNode {
 public:
  /// Whether clients must show a certificate of TLS of Org1's authority.
  enum class Clients { any, with_certificate };

  explicit ServedNode(CoreConfig core = settings(), Clients clients = Clients::any)
      : clients_(clients),
        dir_(std::filesystem::temp_directory_path() / ("ledgerline_served_" + std::to_string(::getpid()))) {
    std::filesystem::remove_all(dir_);
    Node::Options options;
    options.dir = dir_;
    options.core = std::move(core);
    auto opened = Node::open(options);
    EXPECT_TRUE(opened.ok()) << opened.error().message;
    node_ = std::move(*opened);
    auto started =
        Server::start(*node_, "127.0.0.1:0", clients == Clients::any ? std::string() : text_of(tls_ca_file()));
    EXPECT_TRUE(started.ok()) << started.error().message;
    server_ = std::move(*started);
  }
  ~ServedNode() {
    server_->stop();
    node_->stop();
    server_.reset();
    std::filesystem::remove_all(dir_);
  }

  static CoreConfig settings() {
    CoreConfig core;
    core.batch_timeout_ns = 2 * ns_per_ms;
    core.max_envelope_bytes = 200'000;
    return core;
  }

  /// A connection of its own; of Org1's User1, where a certificate must be shown.
  std::shared_ptr<grpc::Channel> connect() const {
    grpc::SslCredentialsOptions tls;
    tls.pem_root_certs = text_of(tls_ca_file());
    if (clients_ == Clients::with_certificate) {
      tls.pem_cert_chain = text_of(tls_of_user("User1") / "client.crt");
      tls.pem_private_key = text_of(tls_of_user("User1") / "client.key");
    }
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    return grpc::CreateCustomChannel(server_->endpoint(), grpc::SslCredentials(tls), arguments);
  }

  crypto::SigningIdentity user(int org, const std::string& name) const {
    const std::string msp_id = "Org" + std::to_string(org) + "MSP";
    auto identity = crypto::load_identity(crypto::Library::libcrypto, msp_id, user_msp_dir(dir_, org, name));
    EXPECT_TRUE(identity.ok());
    return *identity;
  }

  /// A new user of Org1, whose certificate holds for so many days.
  crypto::SigningIdentity issued(int days, const std::string& msp_id = "Org1MSP") const {
    const crypto::KeyAndCertificate ca{text_of(organisation(1) / "ca" / "priv_sk"),
                                       text_of(organisation(1) / "ca" / "ca.org1.ledgerline-cert.pem")};
    return identity_of(ca, msp_id, days);
  }
  static crypto::SigningIdentity identity_of(const crypto::KeyAndCertificate& ca, const std::string& msp_id, int days) {
    const auto made = crypto::issue(
        ca, {.common_name = "New@org1.ledgerline", .organization = "", .unit = "client", .sans = {}, .days = days});
    EXPECT_TRUE(made.ok());
    msp::SerializedIdentity serialized;
    serialized.set_mspid(msp_id);
    serialized.set_id_bytes(made->certificate_pem);
    return {{msp_id, crypto::parse_certificate(made->certificate_pem)->subject},
            serialized.SerializeAsString(),
            *crypto::make_signer(crypto::Library::libcrypto, made->key_pem)};
  }

  std::string tls_ca_file() const { return organisation(1) / "tlsca" / "tlsca.org1.ledgerline-cert.pem"; }
  /// Org1's: client.crt and client.key.
  std::filesystem::path tls_of_user(const std::string& name) const {
    return organisation(1) / "users" / (name + "@org1.ledgerline") / "tls";
  }
  const std::string& endpoint() const { return server_->endpoint(); }
  Node& node() { return *node_; }
  const CoreConfig& config() const { return node_->config(); }

 private:
  std::filesystem::path organisation(int number) const {
    return dir_ / "crypto" / "peerOrganizations" / ("org" + std::to_string(number) + ".ledgerline");
  }

  const Clients clients_;
  std::filesystem::path dir_;
  std::unique_ptr<Node> node_;
  std::unique_ptr<Server> server_;
};

}  // namespace ledgerline::node
