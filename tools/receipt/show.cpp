#include "tools/receipt/show.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "common/base/printable.hpp"

namespace ledgerline::receipt {
namespace {

using Names = std::vector<crypto::IdentityName>;

std::string name_of(const crypto::IdentityName& who) {
  if (who.msp_id.empty()) return "somebody who cannot be told";
  return printable(who.msp_id + " " + who.subject);
}

std::string list_of(const Names& names) {
  std::vector<std::string> texts;
  for (const auto& name : names) texts.push_back(name_of(name));
  return fmt::format("{}", fmt::join(texts, "; "));
}

std::string time_of(TimeNs real_ns) {
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}Z", fmt::gmtime(static_cast<std::time_t>(real_ns / ns_per_s)));
}

std::string others_of(const fabric::Proven& proven) {
  if (proven.others.empty()) return "no other transaction is in this block, so the receipt shows nobody else's";
  std::map<std::string, int> of_whom;
  for (const auto& other : proven.others) ++of_whom[name_of(other.creator)];
  std::vector<std::string> texts;
  for (const auto& [who, count] : of_whom) texts.push_back(fmt::format("{} of {}", count, who));
  return fmt::format("the receipt also shows this block's other transactions (unchecked): {}", fmt::join(texts, "; "));
}

nlohmann::json json_of(const crypto::IdentityName& who) {
  return {{"msp_id", printable(who.msp_id)}, {"subject", printable(who.subject)}};
}

nlohmann::json json_of(const Names& names) {
  nlohmann::json all = nlohmann::json::array();
  for (const auto& name : names) all.push_back(json_of(name));
  return all;
}

}  // namespace

std::string words(const fabric::Proven& proven) {
  std::vector<std::string> lines;
  lines.push_back(fmt::format("transaction {} of channel {}", printable(proven.tx_id), printable(proven.channel)));
  lines.push_back(fmt::format("is in block {} ({}), by the word of orderers: {}", proven.block, proven.block_hash,
                              list_of(proven.orderers)));
  lines.push_back(others_of(proven));
  lines.push_back(
      fmt::format("creator, by its own word: {}, at {}", name_of(proven.creator), time_of(proven.timestamp_ns)));
  lines.push_back(fmt::format("call, by the creator's word: {} of {}, arguments: {}, bytes of them: {}",
                              printable(proven.function), printable(proven.contract), proven.arguments,
                              proven.argument_bytes));
  lines.push_back(fmt::format("endorsed by: {}", proven.endorsers.empty() ? "nobody" : list_of(proven.endorsers)));
  lines.push_back(fmt::format("verdict: {}, by the word of peers of {} of {} organisations: {}", proven.verdict,
                              proven.peers.size(), proven.organisations, list_of(proven.peers)));
  return fmt::format("{}", fmt::join(lines, "\n"));
}

std::string json(const fabric::Proven& proven) {
  nlohmann::json others = nlohmann::json::array();
  for (const auto& other : proven.others)
    others.push_back({{"transaction", printable(other.tx_id)}, {"creator", json_of(other.creator)}});
  const nlohmann::json all{{"proven", true},
                           {"transaction", printable(proven.tx_id)},
                           {"channel", printable(proven.channel)},
                           {"block", proven.block},
                           {"block_hash", proven.block_hash},
                           {"orderers", json_of(proven.orderers)},
                           {"others", others},
                           {"creator", json_of(proven.creator)},
                           {"time", time_of(proven.timestamp_ns)},
                           {"contract", printable(proven.contract)},
                           {"function", printable(proven.function)},
                           {"arguments", proven.arguments},
                           {"argument_bytes", proven.argument_bytes},
                           {"endorsers", json_of(proven.endorsers)},
                           {"code", proven.code},
                           {"verdict", proven.verdict},
                           {"peers", json_of(proven.peers)},
                           {"organisations", proven.organisations}};
  return all.dump();
}

}  // namespace ledgerline::receipt
