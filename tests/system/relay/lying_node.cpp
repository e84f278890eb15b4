#include <fcntl.h>
#include <fmt/ranges.h>
#include <grpcpp/grpcpp.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

#include "common/fabric/tx/envelope.hpp"
#include "gateway/gateway.grpc.pb.h"
#include "hil/netem/text_parse.hpp"
#include "hil/sitl/ledger/relay.hpp"
#include "peer/chaincode_event.pb.h"
#include "tests/system/relay/lying_blocks.hpp"
#include "tests/unit/common/fabric/tx/chain_of_tests.hpp"

/// Stands in for ledgerline-node: starts the real one behind itself and hands on everything, but lies with the real key
/// of Org1's peer in one place. Either what Endorse answers is tampered by hil::Relay, from some seconds behind the
/// first command on; or the blocks that the drones' agent is served are hil::ServingPeer's, from SIGUSR1 on.
/// LYING_NODE: the real program; LYING_LIE: a name of hil/sitl/ledger/relay.hpp, LYING_AFTER_S; or LYING_BLOCKS: one of
/// hil/sitl/ledger/serving_peer.hpp, LYING_SEED; LYING_LOG: a JSON file in the end.
namespace {

using namespace ledgerline;
using Clock = std::chrono::steady_clock;

std::string read(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

std::string from_environment(const char* name, const char* otherwise) {
  const char* value = std::getenv(name);
  return value ? value : otherwise;
}

template <typename Message>
Message parsed(const std::string& bytes) {
  Message message;
  message.ParseFromString(bytes);
  return message;
}

/// The plans that an envelope's event tells.
CommandCall reported_by(const std::string& envelope) {
  const auto opened = fabric::open_transaction(envelope);
  const auto event = opened ? parsed<protos::ChaincodeEvent>(opened->result.events()) : protos::ChaincodeEvent();
  return event.event_name() == "command" ? parsed<CommandCall>(event.payload()) : CommandCall();
}

void note(const CommandCall& call, nlohmann::json& plans) {
  for (const DronePlan& plan : call.plans()) plans.push_back({plan.sequence(), plan.state_stamp_ns()});
}

class LyingGateway final : public gateway::Gateway::Service {
 public:
  LyingGateway(const std::shared_ptr<grpc::Channel>& node, hil::Relay::Names names, hil::RelayTampering lie,
               std::chrono::duration<double> after)
      : stub_(gateway::Gateway::NewStub(node)), relay_(std::move(names)), after_(after) {
    relay_.set_tampering(lie);
  }
  std::uint64_t tampered() const { return tampered_; }
  std::uint64_t submitted() const { return submitted_; }
  /// Number and state's stamp of every plan that was asked for, and of those that tampered events tell.
  const nlohmann::json& asked() const { return asked_; }
  const nlohmann::json& reported() const { return reported_; }

  grpc::Status Endorse(grpc::ServerContext* context, const gateway::EndorseRequest* request,
                       gateway::EndorseResponse* response) override {
    const auto forward = grpc::ClientContext::FromServerContext(*context);
    const grpc::Status status = stub_->Endorse(forward.get(), *request, response);
    if (!status.ok()) return status;
    const fabric::Call call = fabric::call_of(request->proposed_transaction().SerializeAsString());
    const std::lock_guard lock(mutex_);
    if (call.function == "command") note(parsed<CommandCall>(call.args.at(0)), asked_);
    if (call.function == "command" && !first_command_) first_command_ = Clock::now();
    if (!first_command_ || Clock::now() - *first_command_ < after_) return status;
    const std::string honest = response->prepared_transaction().SerializeAsString();
    const std::string tampered = relay_.tamper(call, honest);
    if (tampered == honest) return status;
    ++tampered_;
    note(reported_by(tampered), reported_);
    tampered_ids_.insert(request->transaction_id());
    response->mutable_prepared_transaction()->ParseFromString(tampered);
    return status;
  }
  grpc::Status Submit(grpc::ServerContext* context, const gateway::SubmitRequest* request,
                      gateway::SubmitResponse* response) override {
    {
      const std::lock_guard lock(mutex_);
      if (tampered_ids_.contains(request->transaction_id())) ++submitted_;
    }
    const auto forward = grpc::ClientContext::FromServerContext(*context);
    return stub_->Submit(forward.get(), *request, response);
  }
  grpc::Status CommitStatus(grpc::ServerContext* context, const gateway::SignedCommitStatusRequest* request,
                            gateway::CommitStatusResponse* response) override {
    const auto forward = grpc::ClientContext::FromServerContext(*context);
    return stub_->CommitStatus(forward.get(), *request, response);
  }
  grpc::Status Evaluate(grpc::ServerContext* context, const gateway::EvaluateRequest* request,
                        gateway::EvaluateResponse* response) override {
    const auto forward = grpc::ClientContext::FromServerContext(*context);
    return stub_->Evaluate(forward.get(), *request, response);
  }

 private:
  const std::unique_ptr<gateway::Gateway::Stub> stub_;
  nlohmann::json asked_ = nlohmann::json::array(), reported_ = nlohmann::json::array();
  std::mutex mutex_;
  hil::Relay relay_;
  const std::chrono::duration<double> after_;
  std::optional<Clock::time_point> first_command_;
  std::set<std::string> tampered_ids_;
  std::atomic<std::uint64_t> tampered_ = 0, submitted_ = 0;
};

/// The real node, of which the first line says where it listens.
struct Child {
  pid_t pid = -1;
  std::string endpoint;
};

Child start_node(std::vector<std::string> args) {
  for (std::size_t i = 0; i + 1 < args.size(); ++i) {
    if (args[i] == "--listen") args[i + 1] = "127.0.0.1:0";
  }
  std::array<int, 2> out{};
  if (pipe2(out.data(), O_CLOEXEC) != 0) return {};
  Child child;
  child.pid = fork();
  if (child.pid == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    dup2(out[1], STDOUT_FILENO);
    std::vector<char*> words;
    for (std::string& arg : args) words.push_back(arg.data());
    words.push_back(nullptr);
    execv(words[0], words.data());
    _exit(127);
  }
  close(out[1]);
  FILE* lines = fdopen(out[0], "r");
  std::array<char, 1024> line{};
  if (lines && fgets(line.data(), line.size(), lines)) {
    const auto ready = nlohmann::json::parse(line.data(), nullptr, false);
    if (ready.is_object()) child.endpoint = ready.value("endpoint", "");
  }
  return child;
}

int run(int argc, char** argv) {
  sigset_t ends;
  sigemptyset(&ends);
  sigaddset(&ends, SIGTERM);
  sigaddset(&ends, SIGINT);
  sigaddset(&ends, SIGCHLD);
  std::vector<std::string> args{from_environment("LYING_NODE", "")};
  std::string dir, listen;
  for (int i = 1; i < argc; ++i) {
    args.emplace_back(argv[i]);
    if (args.back() == "--dir" && i + 1 < argc) dir = argv[i + 1];
    if (args.back() == "--listen" && i + 1 < argc) listen = argv[i + 1];
  }
  sigaddset(&ends, SIGUSR1);
  const Child node = start_node(args);
  const std::string block_lie_name = from_environment("LYING_BLOCKS", "");
  const auto block_lie = hil::from_word<hil::PeerTampering>(block_lie_name);
  const auto lie =
      block_lie ? hil::RelayTampering::none : hil::from_word<hil::RelayTampering>(from_environment("LYING_LIE", ""));
  if (node.endpoint.empty() || !lie || (!block_lie_name.empty() && !block_lie)) {
    std::fprintf(stderr, "the node did not start, LYING_BLOCKS is no lie, or LYING_LIE is none of %s\n",
                 fmt::format("{}", fmt::join(hil::words_for<hil::RelayTampering>(), ", ")).c_str());
    return 1;
  }
  pthread_sigmask(SIG_BLOCK, &ends, nullptr);  // behind the fork: the node ends by them
  const std::filesystem::path organisations = std::filesystem::path(dir) / "crypto" / "peerOrganizations";
  const std::filesystem::path org1 = organisations / "org1.ledgerline";
  const auto identity = [&](const std::filesystem::path& msp, const char* msp_id) {
    return crypto::load_identity(crypto::Library::libcrypto, msp_id, msp.string()).value();
  };
  const auto peer = org1 / "peers" / "peer0.org1.ledgerline";
  const auto user = [&](const std::string& number) {
    const std::string org = "org" + number + ".ledgerline";
    return identity(organisations / org / "users" / ("User1@" + org) / "msp", ("Org" + number + "MSP").c_str());
  };
  grpc::SslCredentialsOptions trust;
  trust.pem_root_certs = read(org1 / "tlsca" / "tlsca.org1.ledgerline-cert.pem");
  const auto channel = grpc::CreateChannel(node.endpoint, grpc::SslCredentials(trust));
  LyingGateway lying(channel, {identity(peer / "msp", "Org1MSP"), user("1").name, user("2").name}, *lie,
                     std::chrono::duration<double>(std::stod(from_environment("LYING_AFTER_S", "0"))));
  const auto outsider = organisations / "org2.ledgerline" / "peers" / "peer0.org2.ledgerline" / "msp";
  LyingBlocks blocks({channel,
                      {identity(peer / "msp", "Org1MSP"), read(org1 / "ca" / "ca.org1.ledgerline-cert.pem"),
                       identity(outsider, "Org2MSP")},
                      user("1").serialized,
                      block_lie.value_or(hil::PeerTampering::none),
                      std::stoull(from_environment("LYING_SEED", "1"))});
  grpc::SslServerCredentialsOptions tls(GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE);
  tls.pem_key_cert_pairs.push_back({read(peer / "tls" / "server.key"), read(peer / "tls" / "server.crt")});
  grpc::ServerBuilder builder;
  int port = 0;
  builder.AddListeningPort(listen, grpc::SslServerCredentials(tls), &port);
  builder.RegisterService(&lying);
  builder.RegisterService(&blocks);
  const auto server = builder.BuildAndStart();
  if (!server) return 1;
  std::printf("{\"ready\":true,\"endpoint\":\"127.0.0.1:%d\"}\n", port);
  std::fflush(stdout);
  int which = 0;
  while (sigwait(&ends, &which) == 0 && which == SIGUSR1) blocks.begin();
  kill(node.pid, SIGTERM);
  int status = 0;
  waitpid(node.pid, &status, 0);
  server->Shutdown(std::chrono::system_clock::now() + std::chrono::milliseconds(100));
  std::ofstream(from_environment("LYING_LOG", "/dev/null")) << nlohmann::json{{"tampered", lying.tampered()},
                                                                              {"submitted", lying.submitted()},
                                                                              {"asked", lying.asked()},
                                                                              {"reported", lying.reported()},
                                                                              {"blocks", blocks.reported()}}
                                                            << "\n";
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

}  // namespace

int main(int argc, char** argv) { return run(argc, argv); }
