#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/config/config.hpp"
#include "common/fabric/config.hpp"
#include "common/fabric/receipt/asking.hpp"
#include "common/fabric/receipt/receipt.hpp"
#include "common/fabric/receipt/receipt_judge.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/receipt/show.hpp"

namespace {

using namespace ledgerline;

struct Wish {
  std::string transaction, config, out, verify, channel;
  std::vector<std::string> organisations, orderers;  ///< ID=FILE
  bool json = false;
  bool trusts() const { return !channel.empty() || !organisations.empty() || !orderers.empty(); }
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

Result<fabric::ReceiptJudge> judge_of(const Wish& wish) {
  auto organisations = read_roots(wish.organisations);
  if (!organisations) return organisations.error();
  auto orderers = read_roots(wish.orderers);
  if (!orderers) return orderers.error();
  return fabric::ReceiptJudge::from({wish.channel, std::move(*organisations), std::move(*orderers)});
}

Status check(const Wish& wish, const std::string& bytes, const std::string& name) {
  const auto judge = judge_of(wish);
  if (!judge) return judge.error();
  const auto proven = judge->verify(bytes);
  if (proven) {
    print_line(wish.json ? receipt::json(*proven) : receipt::words(*proven));
    return done;
  }
  if (wish.json) print_line(nlohmann::json{{"proven", false}, {"why", proven.error().what}}.dump());
  return Error{fmt::format("{}: nothing is proven: {}", name, proven.error().what)};
}

Status make(const Wish& wish) {
  auto config = Config::load(wish.config);
  if (!config) return config.error();
  auto ledger = fabric::ledger_config(*config);
  if (auto status = config->finish(); !status) return status;
  if (!ledger) return ledger.error();
  const auto asked = fabric::ask_receipt(std::move(ledger).value(), wish.transaction);
  if (!asked) return asked.error();
  for (const std::string& peer : asked->unheard) spdlog::warn("without the answer of {}", peer);
  const std::string bytes = fabric::receipt_bytes(asked->receipt);
  if (wish.trusts()) {
    if (auto status = check(wish, bytes, "the receipt"); !status) return status;
  }
  const std::string out = wish.out.empty() ? wish.transaction + ".receipt" : wish.out;
  if (auto status = replace_file(out, bytes); !status) return status;
  if (!wish.trusts())
    fmt::print("{}: {} bytes, answers of {} peers\n", out, bytes.size(), asked->receipt.answers.size());
  return done;
}

constexpr const char* about =
    "A receipt of one transaction: one file that anybody checks without a network, by the certificates of the\n"
    "authorities of the channel's organisations and orderers. It holds the whole block, so it shows the others'\n"
    "transactions in it as well.";
constexpr const char* notes =
    R"(Make one: TX and --config (as ledgerline-control has it, with an [[endorser]] for each organisation).
Check one: --verify, --channel, --organisation of every organisation of the channel, --orderer. Beside TX the three
check what was made before it is written.
Examples:
  ledgerline receipt --config operator.toml 3f5a... --out stop.receipt
  ledgerline receipt --verify stop.receipt --channel teleop --organisation Org1MSP=org1-ca.pem \
    --organisation Org2MSP=org2-ca.pem --organisation Org3MSP=org3-ca.pem --orderer OrdererMSP=orderer-ca.pem
Exit codes: 0 proven (or made), 1 not proven (or not made), 2 bad usage.)";

/// Empty: what was asked for makes sense.
std::string nonsense(const Wish& wish) {
  if (wish.transaction.empty() == wish.verify.empty()) return "either TX or --verify, please";
  if (wish.verify.empty() && wish.config.empty()) return "a receipt is made with --config";
  if (!wish.verify.empty() && !(wish.config.empty() && wish.out.empty())) return "--verify asks no ledger";
  if (!wish.transaction.empty() && wish.transaction.find_first_not_of("0123456789abcdef") != std::string::npos)
    return "TX is a transaction's id: hexadecimal digits";
  const bool all = !wish.channel.empty() && !wish.organisations.empty() && !wish.orderers.empty();
  if (!all && (wish.trusts() || !wish.verify.empty())) return "to check takes --channel, --organisation and --orderer";
  return "";
}

Status verify(const Wish& wish) {
  const auto bytes = read_file(wish.verify);
  if (!bytes) return bytes.error();
  return check(wish, *bytes, wish.verify);
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line("receipt", about, notes);
  Wish wish;
  line.option("TX", wish.transaction, "id of the transaction, as commands and events tell it");
  line.option("--config", wish.config, "TOML file with [ledger] and [[endorser]]").existing_file();
  line.option("--out", wish.out, "the receipt's file; else TX.receipt here");
  line.option("--verify", wish.verify, "receipt to check").existing_file();
  line.option("--channel", wish.channel, "the channel that it must be of");
  line.option("--organisation", wish.organisations, "an organisation of the channel and its authority's certificate")
      .one_at_a_time()
      .checked_by("ID=FILE", not_named);
  line.option("--orderer", wish.orderers, "an orderers' organisation and its authority's certificate")
      .one_at_a_time()
      .checked_by("ID=FILE", not_named);
  line.flag("--json", wish.json, "what is proven as JSON");
  if (const auto end = line.parse(argc, argv)) return *end;
  if (const std::string why = nonsense(wish); !why.empty()) return fail(Error{why}, exit_usage);
  return exit_code(wish.verify.empty() ? make(wish) : verify(wish));
}
