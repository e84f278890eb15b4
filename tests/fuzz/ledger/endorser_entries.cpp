#include <algorithm>

#include "chaincode/endorser/core/core.hpp"
#include "chaincode/endorser/core/snapshot.hpp"
#include "tests/fuzz/entry.hpp"
#include "tests/unit/chaincode/node/core/fake_network.hpp"

/// An endorser's own state, as its checkpoint keeps it: a failing disk, another version, or whoever may write the file.
namespace ledgerline::fuzz::endorser_part {
namespace {

using namespace node;

fabric::BlockJudge::MakeRegistry members() {
  return [](const std::vector<crypto::MspRoot>& roots) {
    std::vector<std::string> ids;
    for (const crypto::MspRoot& root : roots) ids.push_back(root.msp_id);
    return crypto::make_test_registry(ids);
  };
}

endorser::Core::Setup setup() {
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
    endorser::Core core(setup());
    for (const std::string& raw : net_->chain) {
      const auto block = fabric::decode_block(raw);
      if (!block || !core.take(*block, raw)) return {};
      all.push_back(core.snapshot());
    }
    return all;
  }

  Outcome feed(std::string_view bytes) override {
    endorser::Core core(setup());
    if (const Status restored = core.restore(bytes); !restored)
      return core.height() == 0 && core.hash().empty() ? refused(restored.error().what) : refused("");
    const std::string again = core.snapshot();
    const auto first = endorser::snapshot_from(bytes), second = endorser::snapshot_from(again);
    if (!first || !second || first->end.height != second->end.height || again.size() != bytes.size())
      return refused("");
    (void)core.process_proposal(proposal_, net_->now);
    return accepted();
  }

 private:
  std::unique_ptr<FakeNetwork> net_;
  std::string proposal_;
};

// A spoilt value or hash is a state like another: only who wrote it knows (the file is 0600).
const Registration snapshot({"endorser.snapshot", Kind::bytes, [] { return std::make_unique<SnapshotEntry>(); }});

}  // namespace
}  // namespace ledgerline::fuzz::endorser_part
