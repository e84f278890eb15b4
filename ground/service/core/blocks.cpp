#include "ground/service/core/blocks.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/msg/contract.hpp"

namespace ledgerline::ground::service {
namespace {

using nlohmann::json;

std::size_t kind_of(const fabric::Transaction& tx, std::string_view contract) {
  constexpr std::size_t other = block_kinds.size() - 1, config = other - 1;
  if (tx.config) return config;
  if (tx.contract != contract) return other;
  const auto known = std::find(block_kinds.begin(), block_kinds.begin() + config, contract::current_name(tx.function));
  return known == block_kinds.begin() + config ? other : static_cast<std::size_t>(known - block_kinds.begin());
}

json block_json(const BlockSummary& block) {
  json kinds = json::object();
  for (std::size_t i = 0; i < block_kinds.size(); ++i) {
    if (block.kinds[i] > 0) kinds[std::string(block_kinds[i])] = block.kinds[i];
  }
  return {{"n", block.number},  {"t_ms", to_ms(block.at_ns)}, {"txs", block.transactions},
          {"ours", block.ours}, {"invalid", block.invalid},   {"kinds", std::move(kinds)}};
}

}  // namespace

BlockSummary summary_of(const fabric::Block& block, TimeNs now, std::string_view self, std::string_view contract) {
  BlockSummary summary{.number = block.number, .at_ns = block.received_ns != 0 ? block.received_ns : now};
  for (const fabric::Transaction& tx : block.transactions) {
    ++summary.transactions;
    if (tx.creator == self) ++summary.ours;
    if (tx.code > 0) ++summary.invalid;  // below: an orderer's block, which has no flags
    ++summary.kinds[kind_of(tx, contract)];
  }
  return summary;
}

std::string blocks_message(const std::deque<BlockSummary>& blocks, std::uint64_t reported) {
  json list = json::array();
  for (const BlockSummary& block : blocks) {
    if (block.number > reported) list.push_back(block_json(block));
  }
  return json{{"op", "blocks"}, {"blocks", std::move(list)}}.dump();
}

void CertificateEnds::add(const fabric::Block& block) {
  for (const fabric::Transaction& tx : block.transactions) {
    if (tx.code != 0 || tx.function != contract::set) continue;
    const auto known =
        std::ranges::find_if(writers_, [&](const auto& one) { return one.second.serialized == tx.creator; });
    if (known != writers_.end()) {
      known->second.sets_of_old = 0;
      continue;
    }
    const auto read = crypto::read_serialized(tx.creator);
    if (!read) continue;  // peers take none such
    const std::int64_t begin_s = read->certificate.not_before_s, end_s = read->certificate.not_after_s;
    const auto found = writers_.find(read->name);
    if (found == writers_.end() && writers_.size() >= max_writers) continue;
    // What was signed before a renewal may come behind it. A newer certificate may end sooner, and, since
    // authorities backdate, begin before the one that it replaces.
    if (found != writers_.end() &&
        std::pair(begin_s, end_s) <= std::pair(found->second.not_before_s, found->second.not_after_s) &&
        ++found->second.sets_of_old < sets_of_old)
      continue;
    writers_.insert_or_assign(
        read->name, Writer{tx.creator,
                           begin_s,
                           end_s,
                           {"agent " + read->name.msp_id + " " + read->name.subject, read->name.subject, end_s}});
  }
}

std::vector<crypto::Renewal::Notice> CertificateEnds::pop_due(std::int64_t now_s) {
  std::vector<crypto::Renewal::Notice> words;
  for (auto& [name, writer] : writers_) {
    if (auto word = writer.renewal.pop_end_notice(now_s)) words.push_back(std::move(*word));
  }
  return words;
}

}  // namespace ledgerline::ground::service
