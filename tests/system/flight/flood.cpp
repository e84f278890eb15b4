// Floods the embedded ledger for so long; what it did is a line of JSON at the end. As a member without a role
// `urgent`: envelopes a second that call themselves stops and that nobody has endorsed. `askers`: so many at once ask
// for all of 21,000 keys, written before, as a peer is asked for an endorsement. As an administrator `roles`: enrols so
// many identities of its organisation, however long it takes.
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "common/base/file.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/rt/clock.hpp"
#include "gateway/gateway.pb.h"
#include "ledgerline.pb.h"
#include "tests/system/connect.hpp"
#include "tests/unit/chaincode/node/server/raw_call.hpp"
#include "tests/unit/common/fabric/tx/chain_of_tests.hpp"

using namespace ledgerline;

namespace {

struct Counts {
  std::atomic<std::uint64_t> sent{0}, answered{0}, refused{0};
};

std::shared_ptr<grpc::Channel> connect_to(const fabric::ClientConfig& config) {
  grpc::SslCredentialsOptions tls;
  tls.pem_root_certs = *read_file(config.tls_ca_file);
  return grpc::CreateChannel(config.endpoint, grpc::SslCredentials(tls));
}

/// A stop as its sender makes it up.
std::string unendorsed_stop(const fabric::ClientConfig& config) {
  const auto made = fabric::make_proposal(config.identity, config.where, {"stop", {"tello1"}}, realtime_ns(),
                                          crypto::random_bytes(24));
  const common::Envelope envelope = fabric::endorse(made->signed_proposal, {}, "", "", "");
  gateway::SubmitRequest request;
  request.set_transaction_id(made->tx_id);
  request.set_channel_id(config.where.channel);
  request.mutable_prepared_transaction()->ParseFromString(
      *fabric::sign_envelope(config.identity, envelope.SerializeAsString()));
  return request.SerializeAsString();
}

void wait_for_all(const Counts& counts) {
  while (counts.answered + counts.refused < counts.sent) std::this_thread::sleep_for(std::chrono::milliseconds(5));
}

void call(const std::shared_ptr<grpc::Channel>& channel, const std::string& method, const std::string& request,
          Counts& counts) {
  ++counts.sent;
  node::RawCall::start(
      channel, method, request, std::chrono::seconds(20), [](const std::string&) { return true; },
      [&counts](const grpc::Status& status) { ++(status.ok() ? counts.answered : counts.refused); });
}

void send_urgent(const fabric::ClientConfig& config, TimeNs end_ns, double per_s, Counts& counts) {
  const auto channel = connect_to(config);
  auto at = std::chrono::steady_clock::now();
  while (monotonic_ns() < end_ns) {
    call(channel, "/gateway.Gateway/Submit", unendorsed_stop(config), counts);
    at += std::chrono::microseconds(static_cast<std::int64_t>(1e6 / per_s));
    std::this_thread::sleep_until(at);
  }
  wait_for_all(counts);
}

void write_keys(const std::string& file, const std::string& msp_id) {
  const auto client = connect(file);
  for (int of = 0; of < 21; ++of) {
    SetCall set;
    for (int i = 0; i < 1'000; ++i) {
      Asset& asset = *set.add_assets();
      asset.set_id(msp_id + "/flood" + std::to_string(of * 1'000 + i));
      asset.set_msg_type("t");
      asset.set_msg_data("x");
    }
    const auto outcome = client->submit_and_wait({"set", {set.SerializeAsString()}});
    if (outcome.kind != fabric::Outcome::Kind::committed) std::fprintf(stderr, "set: %s\n", outcome.message.c_str());
  }
}

void ask(const fabric::ClientConfig& config, TimeNs end_ns, int askers, Counts& counts) {
  std::vector<std::jthread> all;
  for (int i = 0; i < askers; ++i) {
    all.emplace_back([&config, &counts, end_ns] {
      const auto channel = connect_to(config);
      while (monotonic_ns() < end_ns) {
        const auto made = fabric::make_proposal(config.identity, config.where, {"get", {"*"}}, realtime_ns(),
                                                crypto::random_bytes(24));
        Counts own;
        call(channel, "/protos.Endorser/ProcessProposal", made->signed_proposal, own);
        wait_for_all(own);
        ++counts.sent;
        ++(own.answered > 0 ? counts.answered : counts.refused);
      }
    });
  }
}

void enroll(const std::string& file, const std::string& msp_id, int identities, Counts& counts) {
  const auto client = connect(file);
  for (int i = 0; i < identities; ++i) {
    EnrollCall call;
    call.set_role(AUDITOR);
    call.mutable_identity()->set_msp_id(msp_id);
    call.mutable_identity()->set_subject("CN=s" + std::to_string(i));
    ++counts.sent;
    const auto outcome = client->submit_and_wait({"enroll", {call.SerializeAsString()}});
    ++(outcome.kind == fabric::Outcome::Kind::committed ? counts.answered : counts.refused);
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Floods a ledger"};
  std::string file, what;
  double seconds = 20, per_s = 350;
  int askers = 4, identities = 10'050;
  app.add_option("--config", file, "TOML file with [ledger]")->required();
  app.add_option("what", what)->required()->check(CLI::IsMember({"urgent", "askers", "roles"}));
  app.add_option("--seconds", seconds);
  app.add_option("--per-second", per_s, "Of urgent envelopes");
  app.add_option("--askers", askers);
  app.add_option("--identities", identities, "Of roles");
  CLI11_PARSE(app, argc, argv);
  const fabric::ClientConfig config = ledger_of(file);
  if (what == "askers") write_keys(file, config.identity.name.msp_id);
  std::puts("{\"begins\": true}");
  std::fflush(stdout);
  Counts counts;
  const TimeNs end_ns = monotonic_ns() + from_seconds(seconds);
  if (what == "urgent") {
    send_urgent(config, end_ns, per_s, counts);
  } else if (what == "askers") {
    ask(config, end_ns, askers, counts);
  } else {
    enroll(file, config.identity.name.msp_id, identities, counts);
  }
  const nlohmann::json reported{
      {"sent", counts.sent.load()}, {"answered", counts.answered.load()}, {"refused", counts.refused.load()}};
  std::puts(reported.dump().c_str());
}
