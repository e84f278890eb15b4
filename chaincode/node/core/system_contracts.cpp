#include "chaincode/node/core/endorser.hpp"

#include <charconv>

#include "chaincode/node/core/types.hpp"
#include "common/base/text.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/ledger.pb.h"
#include "peer/query.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::node {
namespace {

chaincode::Response answer(const google::protobuf::MessageLite& message) {
  return {200, {}, message.SerializeAsString()};
}

chaincode::Response refuse(const std::string& why) { return {500, printable(why, max_name), {}}; }

}  // namespace

bool is_system_contract(const std::string& contract) { return contract == "qscc" || contract == "cscc"; }

std::optional<chaincode::Response> query_system_contract(const Ledger& ledger, const std::string& channel,
                                                         const ProposalParts& proposal) {
  if (!is_system_contract(proposal.contract)) return std::nullopt;
  const std::string& function = proposal.function;
  const auto argument = [&](std::size_t i) { return i < proposal.args.size() ? proposal.args[i] : std::string(); };
  if (proposal.contract == "cscc" && function == "GetChannels") {
    protos::ChannelQueryResponse channels;
    channels.add_channels()->set_channel_id(channel);
    return answer(channels);
  }
  if (argument(0) != channel) return refuse("Invalid chain ID, " + argument(0));
  const auto block_answer = [&](std::uint64_t number) {
    const auto block = ledger.block_at(number);
    return block ? answer(*block) : refuse(block.error().message);
  };
  if (proposal.contract == "cscc") {
    if (function == "GetConfigBlock") return block_answer(0);
  } else if (function == "GetChainInfo") {
    common::BlockchainInfo info;
    info.set_height(ledger.height());
    info.set_currentblockhash(ledger.end().hash);
    const auto newest = ledger.block_at(ledger.height() - 1);
    if (!newest) return refuse(newest.error().message);
    info.set_previousblockhash(newest->header().previous_hash());
    return answer(info);
  } else if (function == "GetBlockByNumber") {
    const std::string text = argument(1);
    std::uint64_t number = 0;
    const auto end = std::from_chars(text.data(), text.data() + text.size(), number);
    if (end.ec != std::errc() || end.ptr != text.data() + text.size()) return refuse(text + " is no block number");
    if (number >= ledger.height())
      return refuse("Failed to get block number " + text + ", there are " + std::to_string(ledger.height()));
    return block_answer(number);
  } else if (function == "GetBlockByTxID" || function == "GetTransactionByID") {
    const auto known = ledger.state().find_tx(argument(1));
    if (!known) return refuse("Failed to get transaction with id " + argument(1) + ": there is none");
    if (function == "GetBlockByTxID") return block_answer(known->block);
    const auto block = ledger.block_at(known->block);
    if (!block) return refuse(block.error().message);
    for (const std::string& bytes : block->data().data()) {
      if (fabric::read_form(bytes).channel_header.tx_id() != argument(1)) continue;
      protos::ProcessedTransaction transaction;
      if (!transaction.mutable_transactionenvelope()->ParseFromString(bytes)) break;
      transaction.set_validationcode(known->code);
      return answer(transaction);
    }
    return refuse("block " + std::to_string(known->block) + " does not hold transaction " + argument(1));
  }
  return refuse("Requested function " + function + " not found.");
}

}  // namespace ledgerline::node
