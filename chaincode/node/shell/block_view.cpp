#include "chaincode/node/shell/block_feed.hpp"

#include "common/common.pb.h"
#include "common/fabric/tx/form.hpp"
#include "gateway/gateway.pb.h"
#include "orderer/ab.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/events.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::node {
namespace {

Status parse(std::string_view bytes, common::Block& block) {
  if (block.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return done;
  return Error{"a committed block does not parse"};
}

int flag(const common::Block& block, int tx) {
  if (block.metadata().metadata_size() <= common::TRANSACTIONS_FILTER) return protos::NOT_VALIDATED;
  const std::string& flags = block.metadata().metadata(common::TRANSACTIONS_FILTER);
  const auto place = static_cast<std::size_t>(tx);
  return place < flags.size() ? static_cast<unsigned char>(flags[place]) : static_cast<int>(protos::NOT_VALIDATED);
}

bool read_event(const fabric::TransactionForm& transaction, protos::ChaincodeEvent& event) {
  return !transaction.action.events().empty() && event.ParseFromString(transaction.action.events());
}

}  // namespace

Status fill_peer(std::string_view bytes, protos::DeliverResponse& response) {
  return parse(bytes, *response.mutable_block());
}

Status fill_with_private_data(std::string_view bytes, protos::DeliverResponse& response) {
  return parse(bytes, *response.mutable_block_and_private_data()->mutable_block());
}

Status fill_filtered(std::string_view bytes, protos::DeliverResponse& response) {
  common::Block block;
  if (Status status = parse(bytes, block); !status) return status;
  protos::FilteredBlock& filtered = *response.mutable_filtered_block();
  filtered.set_number(block.header().number());
  for (int i = 0; i < block.data().data_size(); ++i) {
    const fabric::TransactionForm transaction = fabric::read_form(block.data().data(i));
    filtered.set_channel_id(transaction.channel_header.channel_id());
    protos::FilteredTransaction& entry = *filtered.add_filtered_transactions();
    entry.set_txid(transaction.channel_header.tx_id());
    entry.set_type(static_cast<common::HeaderType>(transaction.channel_header.type()));
    entry.set_tx_validation_code(static_cast<protos::TxValidationCode>(flag(block, i)));
    if (transaction.channel_header.type() != common::ENDORSER_TRANSACTION) continue;
    auto& actions = *entry.mutable_transaction_actions();
    protos::ChaincodeEvent event;
    if (!read_event(transaction, event)) continue;
    event.clear_payload();
    *actions.add_chaincode_actions()->mutable_chaincode_event() = std::move(event);
  }
  return done;
}

Status fill_orderer(std::string_view bytes, orderer::DeliverResponse& response) {
  if (Status status = parse(bytes, *response.mutable_block()); !status) return status;
  auto& metadata = *response.mutable_block()->mutable_metadata();
  if (metadata.metadata_size() > common::TRANSACTIONS_FILTER) {
    metadata.mutable_metadata(common::TRANSACTIONS_FILTER)->clear();
  }
  return done;
}

Status fill_events(std::string_view bytes, const std::string& contract, const std::string& after,
                   gateway::ChaincodeEventsResponse& response) {
  common::Block block;
  if (Status status = parse(bytes, block); !status) return status;
  response.set_block_number(block.header().number());
  for (int i = 0; i < block.data().data_size(); ++i) {
    const fabric::TransactionForm transaction = fabric::read_form(block.data().data(i));
    if (!after.empty() && transaction.channel_header.tx_id() == after) {
      response.clear_events();
      continue;
    }
    protos::ChaincodeEvent event;
    if (flag(block, i) != protos::VALID || !read_event(transaction, event) || event.chaincode_id() != contract)
      continue;
    *response.add_events() = std::move(event);
  }
  return done;
}

}  // namespace ledgerline::node
