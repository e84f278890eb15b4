// Somebody with the key of an organisation's endorser: endorses a host's calls by itself and has them ordered, until
// one is invalid, and then some more. A line of JSON when some were valid, and one at the end.
#include <grpcpp/grpcpp.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/base/file.hpp"
#include "common/fabric/client/client.hpp"
#include "common/rt/clock.hpp"
#include "ledgerline.pb.h"
#include "orderer/ab.grpc.pb.h"
#include "peer/proposal_response.pb.h"
#include "tests/system/connect.hpp"

namespace {

using namespace ledgerline;
using Kind = fabric::Outcome::Kind;

constexpr int more = 5;

fabric::Call sample(int number) {
  SetCall call;
  Asset& asset = *call.add_assets();
  asset.set_id("tello1/state");
  asset.set_msg_type("std_msgs/msg/String");
  asset.set_msg_data(std::to_string(number));
  call.set_stream(true);
  return {"set", {call.SerializeAsString()}};
}

/// The code that each transaction came to, as the peer's blocks have it.
class Codes {
 public:
  void take(const fabric::Block& block) {
    const std::lock_guard lock(mutex_);
    for (const fabric::Transaction& one : block.transactions) found_[one.tx_id] = {one.code, block.number};
    grown_.notify_all();
  }
  struct Found {
    int code = -1;
    std::uint64_t block = 0;
  };
  Found wait_for(const std::string& tx_id) {
    std::unique_lock lock(mutex_);
    grown_.wait_for(lock, std::chrono::seconds(10), [&] { return found_.contains(tx_id); });
    return found_[tx_id];
  }

 private:
  std::mutex mutex_;
  std::condition_variable grown_;
  std::map<std::string, Found> found_;
};

/// The peer's answer, endorsed with the stolen key in place of the peer's.
std::string endorse(const crypto::SigningIdentity& thief, const std::string& peers) {
  protos::ProposalResponse response;
  response.ParseFromString(peers);
  response.mutable_endorsement()->set_endorser(thief.serialized);
  response.mutable_endorsement()->set_signature(*thief.signer->sign(response.payload() + thief.serialized));
  return response.SerializeAsString();
}

bool order(orderer::AtomicBroadcast::Stub& orderer, const std::string& bytes) {
  common::Envelope envelope;
  envelope.ParseFromString(bytes);
  grpc::ClientContext context;
  orderer::BroadcastResponse response;
  const auto stream = orderer.Broadcast(&context);
  return stream->Write(envelope) && stream->Read(&response) && response.status() == common::SUCCESS;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Calls endorsed with a stolen key alone, until they are invalid"};
  std::string host_file, admin_file, stolen, orderer, orderer_ca;
  double seconds = 60;
  app.add_option("--host", host_file, "TOML file with [ledger] of a host")->required();
  app.add_option("--admin", admin_file, "the same of its administrator, who enrols tello1 to it")->required();
  app.add_option("--stolen", stolen, "MSP folder of the endorser")->required();
  app.add_option("--orderer", orderer, "HOST:PORT")->required();
  app.add_option("--orderer-ca", orderer_ca)->required();
  app.add_option("--seconds", seconds);
  CLI11_PARSE(app, argc, argv);
  const auto config = ledger_of(host_file);
  const auto& who = config.identity;
  EnrollCall enroll;
  enroll.mutable_identity()->set_msp_id(who.name.msp_id);
  enroll.mutable_identity()->set_subject(who.name.subject);
  enroll.add_drones("tello1");
  const auto enrolled = connect(admin_file)->submit_and_wait({"enroll", {enroll.SerializeAsString()}});
  const auto host = connect(host_file);
  const auto first = host->submit_and_wait(sample(0));
  if (enrolled.kind != Kind::committed || first.kind != Kind::committed) {
    std::fprintf(stderr, "enroll: %s; set: %s\n", enrolled.message.c_str(), first.message.c_str());
    return 1;
  }
  const auto thief = or_end(stolen, crypto::load_identity(crypto::Library::libcrypto, who.name.msp_id, stolen));
  const auto peer = or_end(host_file, fabric::PeerQueries::create(config));
  grpc::SslCredentialsOptions tls;
  tls.pem_root_certs = or_end(orderer_ca, read_file(orderer_ca));
  const auto stub = orderer::AtomicBroadcast::NewStub(grpc::CreateChannel(orderer, grpc::SslCredentials(tls)));
  Codes codes;
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [&](const fabric::Block& block, std::string_view) { codes.take(block); };
  handlers.on_connection = [](bool, const std::string&) {};
  const auto stream = host->blocks(first.block, std::move(handlers));

  const TimeNs until = monotonic_ns() + static_cast<TimeNs>(seconds * 1e9);
  int valid = 0, made = 0;
  Codes::Found invalid;
  TimeNs at_ns = 0;
  std::vector<int> later;
  while (monotonic_ns() < until && later.size() < more) {
    const auto proposal = or_end("a proposal", fabric::make_proposal(who, config.where, sample(++made), realtime_ns(),
                                                                     crypto::random_bytes(24)));
    const std::string endorsed = endorse(thief, or_end("the peer", peer->propose(proposal.signed_proposal)));
    const std::string envelope = or_end("a transaction", fabric::assemble(proposal, {endorsed}));
    if (!order(*stub, or_end("a transaction", fabric::sign_envelope(who, envelope)))) continue;
    const Codes::Found found = codes.wait_for(proposal.tx_id);
    if (at_ns != 0) {
      later.push_back(found.code);
    } else if (found.code != 0) {
      at_ns = monotonic_ns();
      invalid = found;
    } else if (++valid == 20) {
      std::printf("{\"valid\": %d}\n", valid);
      std::fflush(stdout);
    }
  }
  if (at_ns == 0) {
    std::fprintf(stderr, "none is invalid, %d valid\n", valid);
    return 1;
  }
  std::printf(
      "%s\n",
      nlohmann::json{
          {"valid", valid}, {"code", invalid.code}, {"block", invalid.block}, {"at_ns", at_ns}, {"later", later}}
          .dump()
          .c_str());
  return 0;
}
