#include "tools/receipt/show.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "common/base/text.hpp"
#include "tools/ledger/decode.hpp"

namespace ledgerline::receipt {
namespace {

using Names = std::vector<crypto::IdentityName>;

std::string name_of(const crypto::IdentityName& who) {
  if (who.msp_id.empty()) return "somebody who cannot be identified";
  return printable(who.msp_id + " " + who.subject);
}

std::string list_of(const Names& names) {
  std::vector<std::string> texts;
  for (const auto& name : names) texts.push_back(name_of(name));
  return fmt::format("{}", fmt::join(texts, "; "));
}

/// Unix time; the client that called the peers could claim any.
std::string time_of(std::int64_t real_s) {
  constexpr std::int64_t year_1 = -62'135'596'800, year_9999_end = 253'402'300'799;
  if (real_s < year_1 || real_s > year_9999_end) return "a time that is none";
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}Z", fmt::gmtime(static_cast<std::time_t>(real_s)));
}

std::string others_of(const fabric::ReceiptProof& proven) {
  if (proven.others.empty()) return "no other transaction is in this block, so the receipt shows nobody else's";
  std::map<std::string, int> of_whom;
  for (const auto& other : proven.others) ++of_whom[name_of(other.creator)];
  std::vector<std::string> texts;
  for (const auto& [who, count] : of_whom) texts.push_back(fmt::format("{} of {}", count, who));
  return fmt::format("the receipt also shows this block's other transactions (unchecked): {}", fmt::join(texts, "; "));
}

using Certificate = fabric::ReceiptProof::Certificate;

const char* name_of(Certificate::Role role) {
  switch (role) {
    case Certificate::Role::orderer:
      return "orderer";
    case Certificate::Role::creator:
      return "creator";
    case Certificate::Role::endorser:
      return "endorser";
    case Certificate::Role::peer:
      return "peer";
  }
  return "";
}

bool counts(const Certificate& one) {
  return !one.revoked || one.role == Certificate::Role::creator || one.role == Certificate::Role::endorser;
}

void add_lists(const fabric::ReceiptProof& proven, std::vector<std::string>& lines) {
  if (proven.revocation_lists.empty()) {
    lines.emplace_back("no revocation list was given: whether a certificate has been revoked was not looked at");
    return;
  }
  std::vector<std::string> texts;
  for (const crypto::RevocationList& list : proven.revocation_lists)
    texts.push_back(fmt::format("{}'s of {}", printable(list.msp_id), time_of(list.made_s)));
  lines.push_back(
      fmt::format("revocation lists that were looked at: {}; none was given of: {}", fmt::join(texts, ", "),
                  proven.without_list.empty() ? "nobody" : fmt::format("{}", fmt::join(proven.without_list, ", "))));
}

/// A line for each of which there is something to say.
void add_certificates(const fabric::ReceiptProof& proven, std::int64_t now_s, std::vector<std::string>& lines) {
  const std::size_t before = lines.size();
  for (const Certificate& one : proven.certificates) {
    const std::string whose = fmt::format("certificate of {} {}", name_of(one.role), name_of(one.who));
    if (one.revoked)
      lines.push_back(whose + (counts(one) ? ": revoked by now; the peers validated it when the transaction came"
                                           : ": revoked, so its word was not counted"));
    const std::string then =
        fmt::format("{} valid at {}, which {} claims", one.valid_when_used() ? "was" : "was not", time_of(one.used_s),
                    one.role == Certificate::Role::peer ? "who asked" : "the creator");
    if (one.valid_to_s < now_s) {
      lines.push_back(fmt::format("{}: expired on {}, {}", whose, time_of(one.valid_to_s), then));
    } else if (!one.valid_when_used()) {
      lines.push_back(fmt::format("{}: {}", whose, then));
    }
  }
  if (lines.size() == before) lines.emplace_back("certificates: none has expired, each was valid at the claimed times");
}

nlohmann::json json_of(const crypto::IdentityName& who) {
  return {{"msp_id", printable(who.msp_id)}, {"subject", printable(who.subject)}};
}

nlohmann::json json_of(const Names& names) {
  nlohmann::json all = nlohmann::json::array();
  for (const auto& name : names) all.push_back(json_of(name));
  return all;
}

std::size_t bytes_of(const std::vector<std::string>& arguments) {
  std::size_t bytes = 0;
  for (const std::string& argument : arguments) bytes += argument.size();
  return bytes;
}

nlohmann::json all_of(const fabric::ReceiptProof& proven, std::int64_t now_s) {
  nlohmann::json certificates = nlohmann::json::array(), lists = nlohmann::json::array();
  for (const Certificate& one : proven.certificates) {
    nlohmann::json text = json_of(one.who);
    text.update({{"role", name_of(one.role)},
                 {"valid_from", time_of(one.valid_from_s)},
                 {"valid_to", time_of(one.valid_to_s)},
                 {"expired", one.valid_to_s < now_s},
                 {"used", time_of(one.used_s)},
                 {"valid_when_used", one.valid_when_used()},
                 {"revoked", one.revoked},
                 {"counted", counts(one)}});
    certificates.push_back(std::move(text));
  }
  for (const crypto::RevocationList& list : proven.revocation_lists)
    lists.push_back({{"msp_id", printable(list.msp_id)}, {"made", time_of(list.made_s)}});
  nlohmann::json others = nlohmann::json::array();
  for (const auto& other : proven.others)
    others.push_back({{"transaction", printable(other.tx_id)}, {"creator", json_of(other.creator)}});
  nlohmann::json all{{"proven", true},
                     {"transaction", printable(proven.tx_id)},
                     {"channel", printable(proven.channel)},
                     {"block", proven.block},
                     {"block_hash", proven.block_hash},
                     {"orderers", json_of(proven.orderers)},
                     {"others", others},
                     {"creator", json_of(proven.creator)},
                     {"time", time_of(proven.timestamp_ns / ns_per_s)},
                     {"contract", printable(proven.contract)},
                     {"function", printable(proven.function)},
                     {"arguments", proven.arguments.size()},
                     {"argument_bytes", bytes_of(proven.arguments)},
                     {"call", ledger::arguments_json(proven.function, proven.arguments)},
                     {"endorsers", json_of(proven.endorsers)},
                     {"code", proven.code},
                     {"verdict", proven.verdict},
                     {"peers", json_of(proven.peers)},
                     {"organisations", proven.organisations},
                     {"certificates", certificates},
                     {"revocation_lists", lists},
                     {"without_revocation_list", proven.without_list}};
  return all;
}

}  // namespace

std::string words(const fabric::ReceiptProof& proven, std::int64_t now_s) {
  std::vector<std::string> lines;
  lines.push_back(fmt::format("transaction {} of channel {}", printable(proven.tx_id), printable(proven.channel)));
  lines.push_back(fmt::format("is in block {} ({}), by the word of orderers: {}", proven.block, proven.block_hash,
                              list_of(proven.orderers)));
  lines.push_back(others_of(proven));
  lines.push_back(fmt::format("creator, by its own word: {}, at {}", name_of(proven.creator),
                              time_of(proven.timestamp_ns / ns_per_s)));
  lines.push_back(fmt::format("call, by the creator's word: {} of {}, arguments: {}, bytes of them: {}",
                              printable(proven.function), printable(proven.contract), proven.arguments.size(),
                              bytes_of(proven.arguments)));
  if (!proven.arguments.empty()) {
    lines.push_back(ledger::lines({{"asked for", ledger::arguments_json(proven.function, proven.arguments)}}));
    lines.back().pop_back();  // its last line's end
  }
  lines.push_back(fmt::format("endorsed by: {}", proven.endorsers.empty() ? "nobody" : list_of(proven.endorsers)));
  lines.push_back(fmt::format("verdict: {}, by the word of peers of {} of {} organisations: {}", proven.verdict,
                              proven.peers.size(), proven.organisations, list_of(proven.peers)));
  add_lists(proven, lines);
  add_certificates(proven, now_s, lines);
  return fmt::format("{}", fmt::join(lines, "\n"));
}

std::string json(const fabric::ReceiptProof& proven, std::int64_t now_s) { return all_of(proven, now_s).dump(); }

std::string line(const std::string& file, const Result<fabric::ReceiptProof>& proven) {
  if (!proven) return fmt::format("{}: nothing is proven: {}", file, proven.error().message);
  return fmt::format("{}: proven: transaction {} in block {}: {}, by the word of peers of {} of {} organisations", file,
                     printable(proven->tx_id), proven->block, proven->verdict, proven->peers.size(),
                     proven->organisations);
}

std::string json_line(const std::string& file, const Result<fabric::ReceiptProof>& proven, std::int64_t now_s) {
  nlohmann::json all =
      proven ? all_of(*proven, now_s) : nlohmann::json{{"proven", false}, {"why", proven.error().message}};
  all["file"] = printable(file);
  return all.dump();
}

}  // namespace ledgerline::receipt
