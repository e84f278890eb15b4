#include <algorithm>

#include "chaincode/endorser/core/endorser_core.hpp"
#include "tests/fuzz/entry.hpp"
#include "tests/unit/chaincode/endorser/first_state/snapshots_of_tests.hpp"
#include "tests/unit/chaincode/node/core/fake_network.hpp"

/// An endorser's own state, as its checkpoint keeps it, and a peer's snapshot that it may begin with: a failing disk,
/// another version, or somebody who can write the files.
namespace ledgerline::fuzz::endorser_part {
namespace {

using namespace node;

fabric::BlockValidator::MakeRegistry members() {
  return [](const std::vector<crypto::MspRoot>& roots) {
    std::vector<std::string> ids;
    for (const crypto::MspRoot& root : roots) ids.push_back(root.msp_id);
    return crypto::make_test_registry(ids);
  };
}

endorser::EndorserCore::Setup setup() {
  return {.where = {}, .identity = crypto::make_test_identity({"Org1MSP", "CN=peer1"}), .make_registry = members()};
}

/// What is refused has changed nothing; what is taken is said again as the same, and proposals are answered behind it.
class SnapshotEntry final : public Entry {
 public:
  SnapshotEntry() {
    CoreConfig config;
    config.orderers = {"OrdererMSP", "ca of OrdererMSP"};
    net_ = std::make_unique<FakeNetwork>(config);
    net_->submit(net_->admin1, "enroll", enroll_call(net_->host.name, {"tello1"}));
    net_->submit(net_->host, "set", note("tello1/a"));
    proposal_ = net_->propose(net_->host, "set", note("tello1/b")).signed_proposal;
  }

  std::vector<std::string> seeds() override {
    std::vector<std::string> all;
    endorser::EndorserCore core(setup());
    for (const std::string& raw : net_->chain) {
      const auto block = fabric::decode_block(raw);
      if (!block || !core.apply(*block, raw)) return {};
      all.push_back(core.snapshot());
    }
    return all;
  }

  Outcome feed(std::string_view bytes) override {
    endorser::EndorserCore core(setup());
    if (const Status restored = core.restore(bytes); !restored)
      return core.height() == 0 && core.hash().empty() ? refused(restored.error().message) : refused("");
    const std::string again = core.snapshot();
    const auto first = endorser::read_snapshot(bytes), second = endorser::read_snapshot(again);
    // The one of before did not say since when its history is.
    const std::size_t added = bytes.starts_with("ledgerline endorser 1") ? sizeof(std::uint64_t) : 0;
    if (!first || !second || first->end.height != second->end.height || again.size() != bytes.size() + added)
      return refused("");
    (void)core.process_proposal(proposal_, net_->now);
    return accepted();
  }

 private:
  std::unique_ptr<FakeNetwork> net_;
  std::string proposal_;
};

/// A peer's snapshot whose files somebody changed, who wrote their hashes, too: each file behind its length.
class PeerSnapshotEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    node::State::Parts contract;
    contract.values["a"] = {"1", {1, 0}, "policy"};
    contract.values["b"] = {std::string(300, 'b'), {2, 300}};
    for (const char digit : {'0', 'a', 'f'}) contract.txs[std::string(64, digit)] = {};
    common::Payload payload;
    common::Envelope envelope;
    common::Block config;
    payload.set_data("configuration");
    envelope.set_payload(payload.SerializeAsString());
    config.mutable_data()->add_data(envelope.SerializeAsString());
    endorser::Snapshot known{{3, std::string(32, 'h')}, config.SerializeAsString(), node::State(contract), {}};
    const endorser::PeerSnapshotFiles files = endorser::snapshot_of(known);
    std::string all;
    for (const std::string* one : {&files.states, &files.states_counts, &files.ids, &files.ids_count})
      all += std::string{static_cast<char>(one->size() & 255), static_cast<char>(one->size() >> 8)} + *one;
    return {all};
  }

  Outcome feed(std::string_view bytes) override {
    endorser::PeerSnapshotFiles files;
    for (std::string* one : {&files.states, &files.states_counts, &files.ids, &files.ids_count}) {
      if (bytes.size() < 2) break;
      const std::size_t size = static_cast<unsigned char>(bytes[0]) | static_cast<unsigned char>(bytes[1]) << 8;
      *one = bytes.substr(2, size);
      bytes.remove_prefix(std::min(bytes.size(), 2 + size));
    }
    endorser::seal(files, {3, std::string(32, 'h')});
    return outcome_of(endorser::read_peer_snapshot(files, {}, {}));
  }
};

/// What a peer's snapshot says of itself.
class DescriptionEntry final : public Entry {
 public:
  DescriptionEntry() {
    endorser::put_states(files_, {{"", {endorser::state_record("CHANNEL_CONFIG_ENV_BYTES", {"c", {0, 0}})}}});
    endorser::put_ids(files_, {});
    endorser::seal(files_, {3, std::string(32, 'h')});
  }
  std::vector<std::string> seeds() override { return {files_.description}; }
  Outcome feed(std::string_view bytes) override {
    endorser::PeerSnapshotFiles files = files_;
    files.description = bytes;
    files.description_hash = R"({"snapshot_hash":")" + crypto::hex(crypto::sha256(bytes)) + R"("})";
    return outcome_of(endorser::read_peer_snapshot(files, {}, {}));
  }

 private:
  endorser::PeerSnapshotFiles files_;
};

// A spoilt value or hash is a state like another: only who wrote it knows (the file is 0600).
const Registration snapshot({"endorser.snapshot", Kind::bytes, [] { return std::make_unique<SnapshotEntry>(); }});
const Registration peer_snapshot({"endorser.peer_snapshot", Kind::bytes,
                                  [] { return std::make_unique<PeerSnapshotEntry>(); }});
const Registration description({"endorser.peer_snapshot_description", Kind::json,
                                [] { return std::make_unique<DescriptionEntry>(); }});

}  // namespace
}  // namespace ledgerline::fuzz::endorser_part
