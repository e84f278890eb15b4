#include <gmock/gmock.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include <filesystem>
#include <fstream>

#include "common/common.pb.h"
#include "common/crypto/crypto.hpp"
#include "peer/chaincode.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/chaincode_shim.grpc.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "tests/unit/chaincode/shim/messages.hpp"
#include "tests/unit/child.hpp"

/// The example chaincode as a peer meets it: the program, its transport, its TLS. Argument: the program.
namespace ledgerline::shim {

std::string program;

namespace {

using ::testing::HasSubstr;
using Message = protos::ChaincodeMessage;
namespace fs = std::filesystem;

/// One stream to the chaincode, with a state of its own.
class Peer {
 public:
  Peer(const std::string& endpoint, const std::shared_ptr<grpc::ChannelCredentials>& tls)
      : stub_(protos::Chaincode::NewStub(grpc::CreateChannel(endpoint, tls))) {
    context_.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(30));
    stream_ = stub_->Connect(&context_);
  }
  ~Peer() {
    context_.TryCancel();
    stream_->Finish();
  }

  /// False: the chaincode does not take this peer.
  bool registers() {
    Message message;
    if (!stream_->Read(&message)) return false;
    protos::ChaincodeID id;
    EXPECT_EQ(message.type(), Message::REGISTER);
    EXPECT_TRUE(id.ParseFromString(message.payload()));
    EXPECT_EQ(id.name(), "counter:1");
    return tell(Message::REGISTERED) && tell(Message::READY);
  }

  bool tell(Message::Type type, const std::string& payload = {}, const std::string& tx = {}) {
    return stream_->Write(message(type, payload, tx));
  }

  void call(const std::string& tx, const std::vector<std::string>& args) {
    protos::ChaincodeInput input;
    for (const std::string& arg : args) input.add_args(arg);
    common::Header header;
    header.set_signature_header(common::SignatureHeader().SerializeAsString());
    protos::Proposal proposal;
    proposal.set_header(header.SerializeAsString());
    Message call = message(Message::TRANSACTION, input.SerializeAsString(), tx);
    call.mutable_proposal()->set_proposal_bytes(proposal.SerializeAsString());
    EXPECT_TRUE(stream_->Write(call));
  }

  /// Answers what it is asked until a transaction has ended.
  Message next_end() {
    for (Message asked; stream_->Read(&asked);) {
      if (asked.type() == Message::GET_STATE) {
        protos::GetState get;
        EXPECT_TRUE(get.ParseFromString(asked.payload()));
        tell(Message::RESPONSE, state[get.key()], asked.txid());
      } else if (asked.type() == Message::PUT_STATE) {
        protos::PutState put;
        EXPECT_TRUE(put.ParseFromString(asked.payload()));
        state[put.key()] = put.value();
        tell(Message::RESPONSE, {}, asked.txid());
      } else {
        return asked;
      }
    }
    ADD_FAILURE() << "the stream has ended";
    return {};
  }

  std::map<std::string, std::string> state;

 private:
  std::unique_ptr<protos::Chaincode::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<Message, Message>> stream_;
};

class ExampleTest : public ::testing::Test {
 protected:
  ExampleTest() : dir(fs::temp_directory_path() / ("ledgerline_example_" + std::to_string(::getpid()))) {
    fs::create_directories(dir);
    for (const char* name :
         {"CHAINCODE_TLS_KEY", "CHAINCODE_TLS_CERT", "CHAINCODE_TLS_CLIENT_CA", "CHAINCODE_TLS_CLIENT_NAMES"})
      ::unsetenv(name);
    ::setenv("CHAINCODE_ID", "counter:1", 1);
    ::setenv("CHAINCODE_SERVER_ADDRESS", "127.0.0.1:0", 1);
  }
  ~ExampleTest() override { fs::remove_all(dir); }

  std::string start() {
    child.start({program});
    const std::string line = child.ready_line();  // its endpoint
    EXPECT_NE(line, "");
    return line.substr(0, line.find('\n'));
  }
  std::string file(const std::string& name, const std::string& text) const {
    std::ofstream(dir / name) << text;
    fs::permissions(dir / name, fs::perms::owner_read | fs::perms::owner_write);
    return dir / name;
  }

  const fs::path dir;
  Child child;
};

TEST_F(ExampleTest, CountsOnTheLedgerAndEndsOnItsSignal) {
  Peer peer(start(), grpc::InsecureChannelCredentials());
  ASSERT_TRUE(peer.registers());
  for (const char* expected : {"1", "2"}) {
    peer.call("tx", {"add", "laps"});
    const Message end = peer.next_end();
    EXPECT_EQ(response_in(end).payload(), expected);
    EXPECT_EQ(end.chaincode_event().event_name(), "added");
    EXPECT_EQ(end.chaincode_event().payload(), expected);
    EXPECT_EQ(peer.state["laps"], expected);
  }
  peer.call("tx", {"read", "laps"});
  EXPECT_EQ(response_in(peer.next_end()).payload(), "2");
  peer.call("tx", {"halve", "laps"});
  const auto refused = response_in(peer.next_end());
  EXPECT_EQ(refused.status(), 500);
  EXPECT_THAT(refused.message(), HasSubstr("unknown function halve"));
  EXPECT_EQ(child.end(SIGTERM), 0);
}

TEST_F(ExampleTest, ServesManyPeers) {
  const std::string endpoint = start();
  Peer one(endpoint, grpc::InsecureChannelCredentials()), other(endpoint, grpc::InsecureChannelCredentials());
  ASSERT_TRUE(one.registers() && other.registers());
  one.call("tx", {"add", "a"});
  other.call("tx", {"add", "a"});
  EXPECT_EQ(response_in(one.next_end()).payload(), "1");
  EXPECT_EQ(response_in(other.next_end()).payload(), "1");
  EXPECT_EQ(child.end(SIGTERM), 0);
}

TEST_F(ExampleTest, WithAClientCaOnlyPeersWithItsCertificateAreServed) {
  const auto ca = crypto::make_ca("tlsca", "org1");
  ASSERT_TRUE(ca);
  crypto::CertificateRequest request;
  request.common_name = "localhost";
  request.sans = {"127.0.0.1", "localhost"};
  request.tls = true;
  const auto server = crypto::issue(*ca, request), client = crypto::issue(*ca, request);
  ASSERT_TRUE(server && client);
  ::setenv("CHAINCODE_TLS_KEY", file("server.key", server->key_pem).c_str(), 1);
  ::setenv("CHAINCODE_TLS_CERT", file("server.crt", server->certificate_pem).c_str(), 1);
  ::setenv("CHAINCODE_TLS_CLIENT_CA", file("ca.crt", ca->certificate_pem).c_str(), 1);
  const std::string endpoint = start();
  grpc::SslCredentialsOptions tls;
  tls.pem_root_certs = ca->certificate_pem;
  EXPECT_FALSE(Peer(endpoint, grpc::SslCredentials(tls)).registers());
  EXPECT_FALSE(Peer(endpoint, grpc::InsecureChannelCredentials()).registers());
  tls.pem_private_key = client->key_pem;
  tls.pem_cert_chain = client->certificate_pem;
  EXPECT_TRUE(Peer(endpoint, grpc::SslCredentials(tls)).registers());
}

TEST_F(ExampleTest, OfThatAuthoritysCertificatesOnlyThoseWithAKnownNameAreServed) {
  const auto ca = crypto::make_ca("tlsca", "org1");
  ASSERT_TRUE(ca);
  const auto issue = [&](const std::string& name, const std::vector<std::string>& sans) {
    crypto::CertificateRequest request;
    request.common_name = name;
    request.sans = sans;
    request.tls = true;
    return crypto::issue(*ca, request).value();
  };
  const auto server = issue("localhost", {"127.0.0.1"});
  ::setenv("CHAINCODE_TLS_KEY", file("server.key", server.key_pem).c_str(), 1);
  ::setenv("CHAINCODE_TLS_CERT", file("server.crt", server.certificate_pem).c_str(), 1);
  ::setenv("CHAINCODE_TLS_CLIENT_CA", file("ca.crt", ca->certificate_pem).c_str(), 1);
  ::setenv("CHAINCODE_TLS_CLIENT_NAMES", "peer0.org1,peer1.org1", 1);
  const std::string endpoint = start();
  const auto registers = [&](const crypto::KeyAndCertificate& client) {
    return Peer(endpoint, grpc::SslCredentials({ca->certificate_pem, client.key_pem, client.certificate_pem}))
        .registers();
  };
  EXPECT_TRUE(registers(issue("peer0.org1", {"elsewhere"}))) << "by its common name";
  EXPECT_TRUE(registers(issue("a peer", {"localhost", "peer1.org1"}))) << "by an alternative one";
  EXPECT_FALSE(registers(issue("User1@org1", {"localhost"}))) << "the same authority's, but no peer's";
  EXPECT_FALSE(registers(issue("peer0.org1.evil", {"xpeer0.org1"})));
}

}  // namespace
}  // namespace ledgerline::shim

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  if (argc != 2) return 2;
  ledgerline::shim::program = argv[1];
  return RUN_ALL_TESTS();
}
