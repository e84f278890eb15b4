#include <grpcpp/server.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <thread>

#include "common/base/file.hpp"
#include "common/fabric/client/connection.hpp"
#include "common/fabric/tls/tls_server.hpp"
#include "peer/peer.grpc.pb.h"

namespace ledgerline::fabric {
namespace {

/// A server whose certificate names peer0.org1 alone, and that wants a certificate of its authority.
class ClientTls : public testing::Test {
 protected:
  void SetUp() override {
    const auto server = issue("peer0.org1", {"peer0.org1"});
    auto served = serve_by_tls({.name = "test",
                                .listen = "127.0.0.1:0",
                                .key_pem = server.key_pem,
                                .certificate_pem = server.certificate_pem,
                                .client_authorities_pem = authority_.certificate_pem,
                                .max_request_bytes = 1 << 20,
                                .max_memory_bytes = 10'000'000},
                               {&service_});
    ASSERT_TRUE(served) << served.error().message;
    server_ = std::move(served->server);
    endpoint_ = served->endpoint;
    const auto own = issue("drone1", {});
    ASSERT_TRUE(write_file(dir_ + "/own.crt", own.certificate_pem));
    ASSERT_TRUE(write_file(dir_ + "/own.key", own.key_pem, 0600));
    const auto outsider = crypto::make_ca("tlsca.other", "other").value();
    ASSERT_TRUE(write_file(dir_ + "/two.pem", outsider.certificate_pem + authority_.certificate_pem));
    ASSERT_TRUE(write_file(dir_ + "/outsider.pem", outsider.certificate_pem));
  }
  void TearDown() override {
    server_->Shutdown();
    std::filesystem::remove_all(dir_);
  }
  /// Of a client of this server, with its own pair.
  ClientConfig client_config() const {
    ClientConfig config;
    config.endpoint = here().endpoint;
    config.tls_ca_file = here().tls_ca_file;
    config.server_name = here().server_name;
    config.tls_pair = pair();
    config.identity = crypto::make_test_identity({"Org1MSP", "CN=x"});
    return config;
  }
  crypto::KeyAndCertificate issue(const std::string& name, std::vector<std::string> sans) const {
    return crypto::issue(
               authority_,
               {.common_name = name, .organization = "", .unit = std::nullopt, .sans = std::move(sans), .tls = true})
        .value();
  }

  ClientConfig::Server here() const { return {endpoint_, dir_ + "/two.pem", "peer0.org1"}; }
  ClientConfig::TlsPair pair() const { return {dir_ + "/own.crt", dir_ + "/own.key"}; }
  /// Of a client with this peer alone; or why it is none.
  std::string reached(const ClientConfig::Server& server) const {
    ClientConfig config;
    config.endpoint = server.endpoint;
    config.tls_ca_file = server.tls_ca_file;
    config.server_name = server.server_name;
    config.tls_pair = server.tls_pair;
    config.identity = crypto::make_test_identity({"Org1MSP", "CN=x"});
    const auto made = make_connection(std::move(config));
    if (!made) return made.error().message;
    return is_ready((*made)->channels()->peers.at(0)) ? "reached" : "not reached";
  }
  /// Connected for good: a server refuses a certificate only after the client's side is done.
  static bool is_ready(const std::shared_ptr<grpc::Channel>& channel) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(5));
    protos::ProposalResponse response;
    const auto status = protos::Endorser::NewStub(channel)->ProcessProposal(&context, {}, &response);
    return status.error_code() == grpc::StatusCode::UNIMPLEMENTED;
  }

  const crypto::KeyAndCertificate authority_ = crypto::make_ca("tlsca.org1", "org1").value();
  const std::string dir_ = testing::TempDir() + "client-tls" + std::to_string(::getpid());
  protos::Endorser::Service service_;  // answers UNIMPLEMENTED
  std::unique_ptr<grpc::Server> server_;
  std::string endpoint_;
};

TEST_F(ClientTls, AServerThatWantsACertificateIsReachedWithOneAlone) {
  auto server = here();
  EXPECT_EQ(reached(server), "not reached");
  server.tls_pair = pair();
  EXPECT_EQ(reached(server), "reached");
}

TEST_F(ClientTls, AServersAuthoritiesAreReadWholeOrNamed) {
  const auto two = read_client_authorities({dir_ + "/two.pem", dir_ + "/outsider.pem"});
  ASSERT_TRUE(two) << two.error().message;
  EXPECT_NE(two->find(authority_.certificate_pem), std::string::npos);
  EXPECT_TRUE(read_client_authorities({})->empty());
  EXPECT_NE(read_client_authorities({dir_ + "/two.pem", dir_ + "/own.key"}).error().message.find("own.key"),
            std::string::npos);
  EXPECT_FALSE(read_client_authorities({dir_ + "/none.pem"}));
}

TEST_F(ClientTls, TheServersNameMustBeInItsCertificate) {
  auto server = here();
  server.tls_pair = pair();
  server.server_name = "";
  EXPECT_EQ(reached(server), "not reached") << "127.0.0.1 is not";
  server.server_name = "peer1.org1";
  EXPECT_EQ(reached(server), "not reached");
}

TEST_F(ClientTls, APeerThatIsNotReachedIsNamedBeforeTheWordsOfGrpc) {
  ClientConfig config;
  config.endpoint = endpoint_;  // which wants a certificate
  config.tls_ca_file = dir_ + "/two.pem";
  config.identity = crypto::make_test_identity({"Org1MSP", "CN=x"});
  const auto height = (*PeerQueries::create(std::move(config)))->height();
  ASSERT_FALSE(height);
  EXPECT_EQ(height.error().message.find(endpoint_ + " is not reached: is it up, and are endpoint, tls_ca"), 0U)
      << height.error().message;
}

TEST_F(ClientTls, OneOfSeveralAuthoritiesSuffices) {
  auto server = here();
  server.tls_pair = pair();
  server.tls_ca_file = dir_ + "/outsider.pem";
  EXPECT_EQ(reached(server), "not reached");
  server.tls_ca_file = dir_ + "/two.pem";
  EXPECT_EQ(reached(server), "reached");
}

TEST_F(ClientTls, OtherServersHaveTheClientsPairUnlessTheyHaveTheirOwn) {
  ClientConfig config = client_config();
  config.orderers = {here()};
  config.other_peers = {here()};
  config.endorsers = {{"Org2MSP", here().endpoint, here().tls_ca_file, here().server_name}};
  const auto made = make_connection(config).value();
  EXPECT_TRUE(is_ready(made->channels()->orderers.at(0)));
  EXPECT_TRUE(is_ready(made->channels()->peers.at(1)));
  EXPECT_TRUE(is_ready(made->channels()->endorsers.at(0)));
  config.orderers[0].tls_pair = {dir_ + "/none.crt", dir_ + "/none.key"};
  EXPECT_NE(make_connection(config).error().message.find("none.crt"), std::string::npos) << "its own counts";
}

TEST_F(ClientTls, ARenewedPairIsOfNewConnectionsAndReportedOfThemAlone) {
  const auto in_use = std::make_shared<TlsPairsInUse>();
  ClientConfig config = client_config();
  config.tls_in_use = in_use;
  const auto made = make_connection(config).value();
  const auto before = made->channels();
  EXPECT_EQ(made->channels(), before);
  ASSERT_TRUE(write_file(pair().key_file, "no key", 0600));
  EXPECT_EQ(made->channels(), before) << "nobody has checked it";
  const auto next = issue("drone1", {});
  in_use->renew(pair().certificate_file, {next.certificate_pem, next.key_pem});  // whatever lies in the files by now
  const auto after = made->channels();
  ASSERT_NE(after, before);
  const auto hash = crypto::certificate_hash(next.certificate_pem).value();
  EXPECT_EQ(after->peer_tls_hashes.at(0), std::string(hash.begin(), hash.end()));
  EXPECT_NE(before->peer_tls_hashes.at(0), after->peer_tls_hashes.at(0));
  EXPECT_TRUE(is_ready(after->peers.at(0)));
  EXPECT_TRUE(is_ready(before->peers.at(0))) << "who holds the old ones goes on over them";
}

TEST_F(ClientTls, ARenewedPairIsTakenWhenTheAuthoritiesFileCanBeReadAgain) {
  const auto in_use = std::make_shared<TlsPairsInUse>();
  ClientConfig config = client_config();
  config.tls_in_use = in_use;
  const auto made = make_connection(config).value();
  const auto before = made->channels();
  const std::string authorities = read_file(config.tls_ca_file).value();
  ASSERT_TRUE(write_file(config.tls_ca_file, "half a"));
  const auto next = issue("drone1", {});
  in_use->renew(pair().certificate_file, {next.certificate_pem, next.key_pem});
  EXPECT_EQ(made->channels(), before);
  ASSERT_TRUE(write_file(config.tls_ca_file, authorities));
  auto after = made->channels();
  for (int tried = 0; after == before && tried < 300; ++tried) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    after = made->channels();
  }
  ASSERT_NE(after, before) << "without another renewal the old pair would be used until it ends";
  EXPECT_TRUE(is_ready(after->peers.at(0)));
}

TEST_F(ClientTls, APairIsWholeAndItsKeyPrivate) {
  auto server = here();
  server.tls_pair = {dir_ + "/own.crt", ""};
  EXPECT_EQ(reached(server), "tls_certificate and tls_key belong together: one of them is missing");
  server.tls_pair = pair();
  ::chmod((dir_ + "/own.key").c_str(), 0644);
  EXPECT_NE(reached(server).find("may be read by others"), std::string::npos);
}

TEST(WhatAServerSays, NamesTheGatewayThatAnEndpointIsNot) {
  EXPECT_NE(describe({grpc::StatusCode::UNIMPLEMENTED, ""}).find("it is no gateway"), std::string::npos);
  EXPECT_EQ(describe({grpc::StatusCode::UNAVAILABLE, "busy"}), "busy");
}

}  // namespace
}  // namespace ledgerline::fabric
