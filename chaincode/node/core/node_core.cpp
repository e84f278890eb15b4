#include "chaincode/node/core/node_core.hpp"

#include "peer/transaction.pb.h"

namespace ledgerline::node {
NodeCore::NodeCore(CoreConfig config, const std::shared_ptr<crypto::MspRegistry>& registry,
                   const std::vector<crypto::SigningIdentity>& peers, crypto::SigningIdentity orderer,
                   ReadBlock read_block)
    : config_(std::move(config)),
      members_(registry, config_.channel),
      ledger_(std::move(read_block)),
      endorser_(config_, members_, peers, ledger_),
      orderer_(config_, members_, std::move(orderer),
               [this](const std::string& tx_id) { return ledger_.state().find_tx(tx_id).has_value(); }),
      committer_(config_, registry, ledger_) {}

Result<crypto::IdentityName> NodeCore::check_signer(std::string_view serialized, std::string_view message,
                                                    std::string_view signature, Now now) const {
  const auto member = members_.check(serialized, message, signature, now);
  if (!member) return member.error();
  return (*member)->name;
}

std::optional<TimeNs> NodeCore::next_cut() const {
  return committer_.has_block_in_progress() ? std::nullopt : orderer_.next_cut();
}

std::optional<CutBlock> NodeCore::cut(Now now) {
  if (committer_.has_block_in_progress()) return std::nullopt;
  auto block = orderer_.cut(now, ledger_.end());
  if (!block) return std::nullopt;
  return committer_.validate(std::move(*block));
}

std::vector<WaiterAnswer> NodeCore::apply(const CutBlock& block) {
  for (const TxStatus& one : block.transactions) orderer_.settle(one.tx_id, one.code == protos::VALID);
  return committer_.apply(block);
}

}  // namespace ledgerline::node
