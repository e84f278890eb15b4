#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/common.pb.h"
#include "common/crypto/crypto.hpp"
#include "common/fabric/config.hpp"
#include "common/fabric/receipt/receipt.hpp"
#include "common/fabric/receipt/receipt_verifier.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"
#include "tools/receipt/show.hpp"

namespace {

using namespace ledgerline;

struct Options {
  std::string transaction, config, out, channel;
  std::vector<std::string> verify, revocation_lists;
  std::vector<std::string> organisations, orderers;  ///< ID=FILE
  bool json = false;
  bool trusts() const {
    return !channel.empty() || !organisations.empty() || !orderers.empty() || !revocation_lists.empty();
  }
};

std::string not_named(const std::string& text) {
  const auto at = text.find('=');
  return at == 0 || at == std::string::npos || at + 1 == text.size() ? text + ": is not ID=FILE" : "";
}

Result<std::vector<crypto::MspRoot>> read_roots(const std::vector<std::string>& named) {
  std::vector<crypto::MspRoot> roots;
  for (const std::string& text : named) {
    const auto at = text.find('=');
    auto pem = read_file(text.substr(at + 1));
    if (!pem) return pem.error();
    crypto::MspRoot root;
    root.msp_id = text.substr(0, at);
    root.ca_pem = std::move(*pem);
    roots.push_back(std::move(root));
  }
  return roots;
}

Result<std::string> read_lists(const std::vector<std::string>& files, const std::vector<crypto::MspRoot>& roots) {
  std::string all;
  for (const std::string& file : files) {
    const auto pem = read_file(file);
    if (!pem) return pem.error();
    if (const auto lists = crypto::read_revocation_lists(*pem, roots); !lists)
      return Error{fmt::format("{}: {}", file, lists.error().message)};
    all += *pem + "\n";
  }
  return all;
}

Result<fabric::ReceiptVerifier> verifier_of(const Options& options) {
  auto organisations = read_roots(options.organisations);
  if (!organisations) return organisations.error();
  auto orderers = read_roots(options.orderers);
  if (!orderers) return orderers.error();
  std::vector<crypto::MspRoot> all = *organisations;
  all.insert(all.end(), orderers->begin(), orderers->end());
  auto lists = read_lists(options.revocation_lists, all);
  if (!lists) return lists.error();
  return fabric::ReceiptVerifier::from(
      {options.channel, std::move(*organisations), std::move(*orderers), std::move(*lists)});
}

std::int64_t now_s() { return realtime_ns() / ns_per_s; }

Status check(const fabric::ReceiptVerifier& verifier, bool as_json, const std::string& bytes, const std::string& name) {
  const auto proven = verifier.verify(bytes);
  if (proven) {
    print_line(as_json ? receipt::json(*proven, now_s()) : receipt::words(*proven, now_s()));
    return done;
  }
  if (as_json) print_line(nlohmann::json{{"proven", false}, {"why", proven.error().message}}.dump());
  return Error{fmt::format("{}: nothing is proven: {}", name, proven.error().message)};
}

Status check_all(const fabric::ReceiptVerifier& verifier, bool as_json, const std::vector<std::string>& files) {
  std::size_t not_proven = 0;
  for (const std::string& file : files) {
    const auto bytes = read_file(file);
    const Result<fabric::ReceiptProof> proven = bytes ? verifier.verify(*bytes) : bytes.error();
    if (!proven) ++not_proven;
    print_line(as_json ? receipt::json_line(file, proven, now_s()) : receipt::line(file, proven));
  }
  if (not_proven == 0) return done;
  return Error{fmt::format("of {} receipts {} prove nothing", files.size(), not_proven)};
}

/// By the authorities of the channel's own configuration.
Status check_by_config(const std::string& config_block, const std::string& bytes) {
  common::Block block;
  if (!block.ParseFromString(config_block)) return Error{"config_block is no block"};
  auto config = fabric::read_channel_config(block);
  if (!config) return config.error();
  const auto verifier = fabric::ReceiptVerifier::from(
      {config->channel, std::move(config->organisations), std::move(config->orderers), {}});
  if (!verifier) return verifier.error();
  if (const auto proven = verifier->verify(bytes); !proven)
    return Error{fmt::format(
        "the receipt is written, but nothing is proven by it: {}. Name an [[endorser]] of each organisation in the "
        "config; and config_block must be of today's organisations",
        proven.error().message)};
  return done;
}

Status make(const Options& options, fabric::ClientConfig ledger) {
  const std::string config_block = ledger.config_block;
  const auto asked = fabric::collect_receipt(std::move(ledger), options.transaction);
  if (!asked) return asked.error();
  for (const std::string& peer : asked->unheard) spdlog::warn("without the answer of {}", peer);
  const std::string bytes = fabric::receipt_bytes(asked->receipt);
  if (options.trusts()) {
    const auto verifier = verifier_of(options);
    if (!verifier) return verifier.error();
    if (auto status = check(*verifier, options.json, bytes, "the receipt"); !status) return status;
  }
  const std::string out = options.out.empty() ? options.transaction + ".receipt" : options.out;
  if (auto status = replace_file(out, bytes); !status) return status;
  if (options.trusts()) return done;
  fmt::print("{}: {} bytes, answers of {} peers\n", out, bytes.size(), asked->receipt.answers.size());
  return config_block.empty() ? done : check_by_config(config_block, bytes);
}

constexpr const char* about =
    "A receipt of one transaction: one file that anybody checks without a network, by the certificates of the\n"
    "authorities of the channel's organisations and orderers. It holds the whole block, so it shows the others'\n"
    "transactions in it as well.";
constexpr const char* notes =
    R"(Make one: TX and --config (as ledgerline control has it, with an [[endorser]] for each organisation).
Check some: --verify, --channel, --organisation of every organisation of the channel, --orderer, and --crl for every
list of revoked certificates that is known; several receipts are a line each. Beside TX they check what was made before
it is written.
Examples:
  ledgerline receipt --config operator.toml 3f5a... --out stop.receipt
  ledgerline receipt --verify stop.receipt --channel teleop --organisation Org1MSP=org1-ca.pem \
    --organisation Org2MSP=org2-ca.pem --organisation Org3MSP=org3-ca.pem --orderer OrdererMSP=orderer-ca.pem
Exit codes: 0 all proven (or made); 1 one is not, or was not made, or what was made proves nothing by config_block;
2 bad usage.)";

/// Empty: what was asked for makes sense.
std::string nonsense(const Options& options) {
  if (options.transaction.empty() == options.verify.empty()) return "either TX or --verify, please";
  if (options.verify.empty() && options.config.empty()) return "a receipt is made with --config";
  if (!options.verify.empty() && !(options.config.empty() && options.out.empty())) return "--verify asks no ledger";
  if (!options.transaction.empty() && options.transaction.find_first_not_of("0123456789abcdef") != std::string::npos)
    return "TX is a transaction's id: hexadecimal digits";
  const bool all = !options.channel.empty() && !options.organisations.empty() && !options.orderers.empty();
  if (!all && (options.trusts() || !options.verify.empty()))
    return "to check takes --channel, --organisation and --orderer";
  return "";
}

Status verify(const Options& options) {
  const auto verifier = verifier_of(options);
  if (!verifier) return verifier.error();
  if (options.verify.size() > 1) return check_all(*verifier, options.json, options.verify);
  const std::string& file = options.verify.front();
  const auto bytes = read_file(file);
  if (!bytes) return bytes.error();
  return check(*verifier, options.json, *bytes, file);
}

}  // namespace

int ledgerline::command::receipt(int argc, char** argv) {
  CommandLine line("ledgerline receipt", about, notes);
  Options options;
  line.option("TX", options.transaction, "id of the transaction, as commands and events report it");
  line.option("--config", options.config, "TOML file with [ledger] and [[endorser]]").existing_file();
  line.option("--out", options.out, "the receipt's file; else TX.receipt here");
  line.option("--verify", options.verify, "receipts to check").existing_file();
  line.option("--channel", options.channel, "the channel that it must be of");
  line.option("--organisation", options.organisations, "an organisation of the channel and its authority's certificate")
      .one_at_a_time()
      .checked_by("ID=FILE", not_named);
  line.option("--orderer", options.orderers, "an orderers' organisation and its authority's certificate")
      .one_at_a_time()
      .checked_by("ID=FILE", not_named);
  line.option("--crl", options.revocation_lists,
              "certificates that one of these authorities has revoked (X.509 CRL, PEM)")
      .one_at_a_time()
      .existing_file();
  line.flag("--json", options.json, "what is proven as JSON");
  if (const auto end = line.parse(argc, argv)) return *end;
  if (const std::string why = nonsense(options); !why.empty()) return fail(Error{why}, exit_usage);
  if (!options.verify.empty()) return exit_code(verify(options));
  auto ledger = fabric::load_ledger_config(options.config);
  return ledger ? exit_code(make(options, std::move(*ledger))) : fail(ledger.error(), exit_usage);
}
