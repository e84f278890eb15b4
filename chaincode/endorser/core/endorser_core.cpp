#include "chaincode/endorser/core/endorser_core.hpp"

#include <fmt/format.h>

#include "chaincode/node/core/tx/messages.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "peer/lifecycle/chaincode_definition.pb.h"
#include "peer/lifecycle/db.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::endorser {
namespace {

node::CoreConfig config_of(const fabric::ChannelAndContract& where) {
  node::CoreConfig config;
  config.channel = where.channel;
  config.contract = where.contract;
  return config;
}

/// 0: it has no certificate, as in tests.
std::int64_t expiry_of(const crypto::SigningIdentity& identity) {
  const auto read = crypto::read_serialized(identity.serialized);
  return read ? read->certificate.not_after_s : 0;
}

node::Reply refer_to_peer(const std::string& why) { return {node::Code::unavailable, why, why, {}}; }

}  // namespace

EndorserCore::EndorserCore(Setup setup)
    : setup_(std::move(setup)),
      config_(config_of(setup_.where)),
      expires_s_(expiry_of(setup_.identity)),
      ledger_([this](std::uint64_t number) -> Result<std::string> {
        asks_for_blocks_ = true;
        return Error{fmt::format("block {} is not kept here", number)};
      }),
      endorser_(config_, node::MemberCheck(setup_.make_registry({}), config_.channel), {setup_.identity}, ledger_) {}

std::optional<node::Definition> EndorserCore::read_definition() const {
  const std::string fields = "namespaces/fields/" + config_.contract + "/";
  const node::State::Value* sequence = lifecycle_.find(fields + "Sequence");
  const node::State::Value* info = lifecycle_.find(fields + "EndorsementInfo");
  lifecycle::StateData data;
  lifecycle::ChaincodeEndorsementInfo endorsement;
  if (sequence == nullptr || info == nullptr || !data.ParseFromString(info->bytes) ||
      !endorsement.ParseFromString(data.bytes()))
    return std::nullopt;
  return node::Definition{endorsement.version(), sequence->version};
}

std::optional<node::Version> EndorserCore::defined_at() const {
  return definition_ ? definition_->sequence : std::nullopt;
}

Status EndorserCore::check_role(const crypto::SigningIdentity& identity) const {
  const auto self = setup_.make_registry(organisations_)->member(identity.serialized, std::nullopt);
  if (!self) return self.error();
  return (*self)->peer ? Status(done) : Error{"its certificate has not OU=peer"};
}

Status EndorserCore::renew(crypto::SigningIdentity next) {
  if (!organisations_.empty()) {
    if (const Status role = check_role(next); !role)
      return Error{"no endorsement of it would count: " + role.error().message};
  }
  role_ = done;
  expires_s_ = expiry_of(next);
  endorser_.set_peer(0, next);
  setup_.identity = std::move(next);
  return done;
}

Status EndorserCore::configure(const common::Block& message) {
  auto config = fabric::read_channel_config(message);
  if (!config) return config.error();
  if (!config->embedded_node) endorser_.answer_as_fabric([this] { return definition_; });
  embedded_node_ = config->embedded_node;
  organisations_ = std::move(config->organisations);
  role_ = check_role(setup_.identity);
  endorser_.set_members(node::MemberCheck(setup_.make_registry(organisations_), config_.channel));
  return done;
}

std::string EndorserCore::snapshot() const {
  return to_bytes(ledger_.end(), config_block_, ledger_.state(), lifecycle_);
}

Status EndorserCore::restore(std::string_view bytes) {
  auto known = read_snapshot(bytes);
  return known ? restore(std::move(*known)) : known.error();
}

Status EndorserCore::restore(Snapshot known) {
  common::Block config;
  if (!config.ParseFromString(known.config_block)) return Error{"an endorser's state has no configuration"};
  if (Status configured = configure(config); !configured) return configured;
  config_block_ = std::move(known.config_block);
  ledger_.restore(std::move(known.contract), std::move(known.end));
  lifecycle_ = std::move(known.lifecycle);
  definition_ = read_definition();
  return done;
}

/// A transaction whose id another block has used is not valid, whichever source delivered the block. Without the ids of
/// all blocks this cannot be detected.
bool EndorserCore::is_valid(const fabric::Transaction& transaction, std::uint64_t block) const {
  if (transaction.code != protos::VALID) return false;
  const auto known = ledger_.state().find_tx(transaction.tx_id);
  return !known || known->block == block;
}

void EndorserCore::write(const std::string& envelope, node::Version at) {
  const fabric::TransactionForm form = fabric::read_form(envelope);
  const fabric::ReadWriteSet sets = fabric::read_sets(form.action.results());
  ledger_.state().write(node::set_of(sets, config_.contract), at);
  const kvrwset::KVRWSet lifecycle = node::set_of(sets, fabric::lifecycle_name);
  if (lifecycle.writes().empty() && lifecycle.metadata_writes().empty()) return;
  lifecycle_.write(lifecycle, at);
  definition_ = read_definition();
}

Status EndorserCore::apply(const fabric::Block& block, std::string_view raw) {
  const std::string name = fmt::format("block {}", block.number);
  if (block.number != ledger_.height()) return Error{fmt::format("{} came where {} was due", name, ledger_.height())};
  common::Block message;
  if (!message.ParseFromArray(raw.data(), static_cast<int>(raw.size())) || message.header().number() != block.number ||
      message.header().data_hash() != block.data_hash ||
      static_cast<std::size_t>(message.data().data_size()) != block.transactions.size())
    return Error{name + ": its bytes are those of another one"};
  if (message.header().previous_hash() != ledger_.end().hash)
    return Error{name + " does not follow the one before it: it is of another chain"};
  for (std::size_t i = 0; i < block.transactions.size(); ++i) {
    const fabric::Transaction& transaction = block.transactions[i];
    const bool valid = is_valid(transaction, block.number);
    if (transaction.config) {
      if (!valid) continue;
      if (Status configured = configure(message); !configured) return Error{name + ": " + configured.error().message};
      config_block_ = raw;
      continue;
    }
    // In Fabric any client that claims an id uses it up; on the embedded node it belongs to its owner.
    const bool claimed = transaction.code == protos::BAD_PROPOSAL_TXID;
    if (transaction.tx_id.size() == fabric::id_digits && !(claimed && embedded_node_))
      ledger_.state().add_tx(transaction.tx_id, {block.number, transaction.code});
    if (valid) write(message.data().data(static_cast<int>(i)), {block.number, i});
  }
  ledger_.add_block(fabric::header_hash(message.header()));
  return done;
}

node::Reply EndorserCore::process_proposal(std::string_view signed_proposal, node::Now now, bool own) {
  if (expires_s_ != 0 && now.real_ns / ns_per_s > expires_s_)
    return refer_to_peer("the endorser's own certificate has expired");
  if (!role_) return refer_to_peer("no endorsement of this endorser counts: " + role_.error().message);
  auto read = node::read_signed_proposal(signed_proposal);
  // What cannot be read is not for it either.
  if (!read || read->proposal.channel_header.channel_id() != setup_.where.channel ||
      read->proposal.contract != setup_.where.contract)
    return refer_to_peer(for_its_contract_alone);
  asks_for_blocks_ = false;
  node::Reply reply = endorser_.process_proposal(std::move(*read), now, 0, own);
  if (asks_for_blocks_) return refer_to_peer("the endorser keeps no blocks: a peer answers that");
  return reply;
}

}  // namespace ledgerline::endorser
