#include "common/common.pb.h"
#include "common/fabric/tx/transaction.hpp"
#include "tests/fuzz/entry.hpp"
#include "tests/unit/common/fabric/tx/chain_of_tests.hpp"

/// What a peer or gateway sends to a client: blocks and endorsed transactions.
namespace ledgerline::fuzz::fabric_part {
namespace {

using namespace fabric;

const crypto::SigningIdentity client = crypto::make_test_identity({"Org1MSP", "CN=User1@org1"});
const crypto::SigningIdentity peer = crypto::make_test_identity({"Org1MSP", "CN=peer0.org1"});

common::Block sample_block(const std::string& flags) {
  const auto genesis = make_config_block("teleop");
  std::vector<std::string> envelopes;
  for (const char* function : {"set", "command", "stop"}) {
    envelopes.push_back(make_transaction(client, peer, {function, {"event"}}, std::string(24, 'n') + function));
  }
  return make_block(&genesis, envelopes, flags);
}

/// Whatever is taken must be whole: numbers of a chain can be worked out, and a valid transaction has its parts.
Outcome check(const Result<Block>& block) {
  if (!block) return refused(block.error().message);
  ChainCheck chain;
  if (!chain.add(*block) || chain.hash().size() != 32) return refused("");
  for (const Transaction& transaction : block->transactions) {
    const bool left_out = transaction.code == code_unverified;
    if (left_out != !transaction.problem.empty() || (left_out && !transaction.event_name.empty())) return refused("");
    const bool whole = transaction.config || transaction.code != 0 || !transaction.payload.empty();
    if (!whole || transaction.timestamp_ns < 0 || transaction.code < -1 || transaction.code > code_unverified)
      return refused("");
  }
  return accepted();
}

std::unique_ptr<Entry> block() {
  return std::make_unique<Function>(
      std::vector<std::string>{sample_block(std::string("\0\x0b\0", 3)).SerializeAsString(),
                               sample_block("").SerializeAsString(), make_config_block("teleop").SerializeAsString()},
      [](std::string_view bytes) { return check(decode_block(bytes)); });
}

/// The same with the data hash made right again: as a lying orderer would send it, the inner messages are reached.
std::unique_ptr<Entry> sealed_block() {
  return std::make_unique<Function>(
      std::vector<std::string>{sample_block(std::string("\0\x0b\0", 3)).SerializeAsString(),
                               sample_block("").SerializeAsString(), make_config_block("teleop").SerializeAsString()},
      [](std::string_view bytes) {
        common::Block block;
        if (!block.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return check(decode_block(bytes));
        seal(block, nullptr);
        return check(decode_block(block.SerializeAsString()));
      });
}

/// One envelope in a block that flags it valid.
std::unique_ptr<Entry> transaction() {
  return std::make_unique<Function>(
      std::vector<std::string>{make_transaction(client, peer, {"set", {"event"}}, std::string(24, 'n')),
                               make_transaction(client, peer, {"command", {"event"}}, std::string(24, 'm'))},
      [](std::string_view bytes) {
        const auto genesis = make_config_block("teleop");
        const std::string valid(1, '\0');
        const auto block = make_block(&genesis, {std::string(bytes)}, valid);
        const auto unflagged = make_block(&genesis, {std::string(bytes)}, "");
        if (!decode_block(unflagged.SerializeAsString())) return refused("");  // it must not stop who follows the chain
        const auto decoded = decode_block(block.SerializeAsString());
        const Outcome verdict = check(decoded);
        const bool left_out = decoded && decoded->transactions.at(0).code == code_unverified;
        return left_out && verdict.verdict == Outcome::Verdict::accepted ? refused(decoded->transactions[0].problem)
                                                                         : verdict;
      });
}

/// An endorsed transaction that came back: only our own call is signed.
std::unique_ptr<Entry> prepared() {
  const Call call{"set", {"argument"}};
  const auto proposal = make_proposal(client, {}, call, 1'700'000'000 * ns_per_s, std::string(24, 'n')).value();
  const auto other =
      make_proposal(client, {}, {"set", {"another"}}, 1'700'000'000 * ns_per_s, std::string(24, 'n')).value();
  return std::make_unique<Function>(
      std::vector<std::string>{endorse(proposal.signed_proposal, {peer}, "answer", "set", "event").SerializeAsString()},
      [=](std::string_view bytes) {
        // The same bytes can belong to one of the two only.
        const auto mine = check_prepared(proposal, bytes);
        if (mine && check_prepared(other, bytes)) return refused("");
        if (mine && !sign_envelope(client, bytes)) return refused("");
        return outcome_of(mine);
      });
}

const Registration blocks({"fabric.block", Kind::protobuf, block});
const Registration sealed_blocks({"fabric.block_sealed", Kind::protobuf, sealed_block, 0.1});
const Registration transactions({"fabric.transaction", Kind::protobuf, transaction});
const Registration prepared_transaction({"fabric.prepared", Kind::protobuf, prepared});

}  // namespace
}  // namespace ledgerline::fuzz::fabric_part
