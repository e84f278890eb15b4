// Orders transactions that are good and spoilt in many ways on a real network, and validates its whole chain, from
// block 0 on, beside the peer: prints as JSON how many of each kind had which flag, and where validator and peer
// differ.
#include <fmt/format.h>
#include <grpcpp/grpcpp.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "common/base/file.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/validation/transaction_validator.hpp"
#include "msp/identities.pb.h"
#include "orderer/ab.grpc.pb.h"
#include "tests/system/connect.hpp"
#include "tests/unit/common/fabric/validation/drafts.hpp"

using namespace ledgerline;
using namespace ledgerline::fabric;

namespace {

constexpr auto library = crypto::Library::libcrypto;
constexpr TimeNs timeout_ns = 60 * ns_per_s;

[[noreturn]] void fail(const std::string& what) {
  std::fprintf(stderr, "%s\n", what.c_str());
  std::exit(1);
}

template <typename T>
T value_of(Result<T> result, const std::string& what) {
  if (!result) fail(what + ": " + result.error().message);
  return std::move(*result);
}

std::string only_file_in(const std::filesystem::path& directory, const std::string& ending) {
  for (const auto& entry : std::filesystem::directory_iterator(directory)) {
    if (entry.path().string().ends_with(ending)) return value_of(read_file(entry.path()), entry.path());
  }
  fail(directory.string() + " has no file *" + ending);
}

crypto::SigningIdentity issued(const crypto::KeyAndCertificate& ca, const std::string& msp_id,
                               const std::string& unit) {
  const auto made = value_of(
      crypto::issue(ca, {.common_name = "validation." + unit, .organization = msp_id, .unit = unit, .sans = {}}),
      "a certificate");
  msp::SerializedIdentity serialized;
  serialized.set_mspid(msp_id);
  serialized.set_id_bytes(made.certificate_pem);
  return {{msp_id, "CN=validation." + unit},
          serialized.SerializeAsString(),
          value_of(crypto::make_signer(library, made.key_pem), "a key")};
}

/// From the folders that `ledgerline fabric` makes.
Cast cast_of(const std::filesystem::path& crypto_dir) {
  Cast cast;
  for (const std::string k : {"1", "2", "3"}) {
    const std::string name = "org" + k + ".ledgerline", msp_id = "Org" + k + "MSP";
    const std::filesystem::path home = crypto_dir / "peerOrganizations" / name;
    const auto load = [&](const std::string& path) {
      return value_of(crypto::load_identity(library, msp_id, home / path / "msp"), home / path);
    };
    cast.members.push_back(load("users/User1@" + name));
    cast.peers.push_back(load("peers/peer0." + name));
    const crypto::KeyAndCertificate ca{only_file_in(home / "ca", "_sk"), only_file_in(home / "ca", ".pem")};
    cast.new_peers.push_back(issued(ca, msp_id, "peer"));
    if (k != "1") continue;
    cast.client = load("users/User1@" + name);
    cast.admin = load("users/Admin@" + name);
    cast.nobodys = issued(value_of(crypto::make_ca("ca." + name, msp_id), "an authority"), msp_id, "peer");
  }
  return cast;
}

/// The chain as it comes from the peer, validated beside it.
class Beside {
 public:
  /// On the stream's thread.
  void take(std::string_view raw) {
    const std::lock_guard lock(mutex_);
    common::Block block;
    if (!block.ParseFromArray(raw.data(), static_cast<int>(raw.size()))) fail("a block that does not parse");
    if (auto config = read_channel_config(block)) {
      members_ = crypto::make_msp_registry(library, everybody(*config));
      rules_ = {config->channel, !config->embedded_node};
      if (config->embedded_node) state_.define("ledgerline");
      state_.configure(std::move(*config));
    }
    if (!members_) fail("block 0 does not configure the channel");
    const std::uint64_t number = block.header().number();
    // Nobody validates block 0: with it a peer joins the channel.
    if (number > 0) compare(block, validate_transactions(block, state_, *members_, rules_));
    next_ = number + 1;
  }

  /// `make` may look at the state of now; what it makes is of that kind.
  std::string make(const std::string& kind, const std::function<std::string()>& make) {
    const std::lock_guard lock(mutex_);
    std::string envelope = make();
    kinds_[crypto::hex(crypto::sha256(envelope))] = kind;
    return envelope;
  }
  const KeyState& state() const { return state_; }
  bool has_all(std::uint64_t count) {
    const std::lock_guard lock(mutex_);
    return ours_ == count;
  }
  nlohmann::json report() {
    const std::lock_guard lock(mutex_);
    return {
        {"blocks", next_}, {"transactions", transactions_}, {"ours", ours_}, {"kinds", flags_}, {"differ", differ_}};
  }

 private:
  void compare(const common::Block& block, const std::vector<TransactionVerdict>& verdicts) {
    const std::string& flags = block.metadata().metadata(common::TRANSACTIONS_FILTER);
    for (std::size_t i = 0; i < verdicts.size(); ++i) {
      ++transactions_;
      const int flag = static_cast<unsigned char>(flags.at(i));
      const auto found = kinds_.find(crypto::hex(crypto::sha256(block.data().data(static_cast<int>(i)))));
      const std::string kind = found == kinds_.end() ? "not ours" : found->second;
      if (found != kinds_.end()) ++ours_;
      ++flags_[kind][std::to_string(flag)];
      if (flag == verdicts[i].code) continue;
      differ_.push_back({{"block", block.header().number()},
                         {"transaction", i},
                         {"kind", kind},
                         {"peer", flag},
                         {"validator", verdicts[i].code},
                         {"why", verdicts[i].why}});
    }
    state_.apply(block.header().number(), verdicts);
  }

  std::mutex mutex_;
  KeyState state_;
  std::unique_ptr<crypto::MspRegistry> members_;
  ValidationRules rules_;
  std::map<std::string, std::string> kinds_;  ///< by the envelope's hash
  std::map<std::string, std::map<std::string, int>> flags_;
  std::vector<nlohmann::json> differ_;
  std::uint64_t next_ = 0, transactions_ = 0, ours_ = 0;
};

/// One Broadcast stream to the orderer, opened again where it was closed.
class Broadcast {
 public:
  Broadcast(const std::string& endpoint, const std::string& ca_file) {
    grpc::SslCredentialsOptions tls;
    tls.pem_root_certs = value_of(read_file(ca_file), ca_file);
    stub_ = orderer::AtomicBroadcast::NewStub(grpc::CreateChannel(endpoint, grpc::SslCredentials(tls)));
  }
  /// Whether the orderer took it.
  bool send(const std::string& bytes) {
    common::Envelope envelope;
    envelope.ParseFromString(bytes);
    orderer::BroadcastResponse response;
    for (int attempt = 0; attempt < 5; ++attempt) {
      if (!stream_) {
        context_ = std::make_unique<grpc::ClientContext>();
        stream_ = stub_->Broadcast(context_.get());
      }
      if (stream_->Write(envelope) && stream_->Read(&response)) {
        if (response.status() != common::SUCCESS) stream_.reset();
        if (response.status() != common::SERVICE_UNAVAILABLE) return response.status() == common::SUCCESS;
      }
      stream_.reset();
    }
    fail("the orderer was not reached");
  }

 private:
  std::unique_ptr<orderer::AtomicBroadcast::Stub> stub_;
  std::unique_ptr<grpc::ClientContext> context_;
  std::unique_ptr<grpc::ClientReaderWriter<common::Envelope, orderer::BroadcastResponse>> stream_;
};

/// Until that many were seen in blocks.
void wait_for(Beside& beside, std::uint64_t ordered) {
  const TimeNs end_ns = monotonic_ns() + timeout_ns;
  while (!beside.has_all(ordered)) {
    if (monotonic_ns() > end_ns) fail("not all were seen in blocks: " + beside.report().dump());
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
}

Draft draft_of(const Cast& cast, Random& random) {
  Draft draft;
  draft.creator = &cast.members[random.next() % cast.members.size()];
  draft.endorsers = {&cast.peers[0], &cast.peers[1]};
  draft.channel_header.set_type(common::ENDORSER_TRANSACTION);
  draft.channel_header.set_channel_id("teleop");
  draft.extension.mutable_chaincode_id()->set_name("ledgerline");
  draft.action.mutable_chaincode_id()->set_name("ledgerline");
  draft.action.mutable_chaincode_id()->set_version("1");
  draft.action.mutable_response()->set_status(200);
  draft.nonce = crypto::random_bytes(24);
  return draft;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Validator and peer, side by side"};
  std::string config, crypto_dir, orderer, orderer_ca;
  std::uint64_t count = 600, seed = 1;
  app.add_option("--config", config, "a member's, with [ledger]")->required();
  app.add_option("--crypto", crypto_dir)->required();
  app.add_option("--orderer", orderer)->required();
  app.add_option("--orderer-ca", orderer_ca)->required();
  app.add_option("--count", count);
  app.add_option("--seed", seed);
  CLI11_PARSE(app, argc, argv);

  const Cast cast = cast_of(crypto_dir);
  Beside beside;
  const auto client = connect(config);
  const auto stream = client->blocks(0, {.on_block = [&](const Block&, std::string_view raw) { beside.take(raw); },
                                         .on_connection =
                                             [](bool, const std::string& why) {
                                               if (!why.empty()) std::fprintf(stderr, "%s\n", why.c_str());
                                             }});
  Random random(seed);
  const std::vector<Kind> all = kinds(cast, beside.state(), random);
  Broadcast broadcast(orderer, orderer_ca);
  // What sets a policy is not ordered again: where a write of that key stands behind it in the block, peers wait, too.
  std::string last;
  std::uint64_t ordered = 0;
  for (std::uint64_t i = 0; i < count; ++i) {
    // In turn at first, so that each has been there; then at random, so that each meets each in one block.
    const Kind& kind = all[i < 2 * all.size() ? i % all.size() : random.next() % all.size()];
    bool sets_policy = false;
    const std::string envelope = beside.make(kind.again ? "ordered again" : kind.name, [&] {
      if (kind.again && !last.empty()) return last;
      Draft draft = draft_of(cast, random);
      if (kind.bend) kind.bend(draft);
      sets_policy = !draft.set.metadata_writes().empty();
      return draft.seal();
    });
    if (kind.alone) wait_for(beside, ordered);
    if (!broadcast.send(envelope)) fail("the orderer refused: " + kind.name);
    ++ordered;
    if (kind.alone) wait_for(beside, ordered);
    if (!sets_policy && !kind.alone) last = envelope;
  }
  wait_for(beside, ordered);
  std::printf("%s\n", beside.report().dump().c_str());
  return 0;
}
