#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>

#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/verification/control_records.hpp"
#include "tools/audit/source.hpp"
#include "tools/command/verbs.hpp"
#include "tools/ledger/decode.hpp"

namespace {

using namespace ledgerline;
using json = nlohmann::ordered_json;

struct Options {
  std::string config, blocks, id, transaction;
  int limit = 10;
  bool json = false;
};

void print(const Options& options, const json& value) {
  if (options.json)
    print_line(value.dump(-1, ' ', false, json::error_handler_t::replace));
  else
    fmt::print("{}", ledger::lines(value));
}

Status get(const Options& options, fabric::ClientConfig config) {
  const auto client = fabric::Client::create(std::move(config));
  if (!client) return client.error();
  json assets = json::array();
  const auto evaluate = [&](const fabric::Call& call) { return (*client)->evaluate(call); };
  const Status read = verification::read_pages(options.id, evaluate, [&](const Assets& page) {
    for (const Asset& asset : page.assets()) assets.push_back(ledger::asset_json(asset));
    return done;
  });
  if (!read) return read;
  if (assets.empty()) return Error{options.id + ": the ledger has nothing under it"};
  print(options, assets.size() == 1 ? assets.front() : assets);
  return done;
}

Status history(const Options& options, fabric::ClientConfig config) {
  const auto client = fabric::Client::create(std::move(config));
  if (!client) return client.error();
  std::vector<Version> versions;
  QueryCall asked;
  asked.set_id(options.id);
  do {
    const auto answer = (*client)->evaluate({contract::history, {asked.SerializeAsString()}});
    if (!answer) return Error{fmt::format("{}: {}", options.id, answer.error().message)};
    Versions page;
    if (const Status parsed = parse_message(*answer, page); !parsed) return parsed;
    if (!page.bookmark().empty() && (page.bookmark() == asked.bookmark() || page.versions().empty()))
      return Error{"the ledger's pages do not end"};
    versions.insert(versions.end(), page.versions().begin(), page.versions().end());
    asked.set_bookmark(page.bookmark());
  } while (!asked.bookmark().empty() && versions.size() < static_cast<std::size_t>(options.limit));
  versions.resize(std::min(versions.size(), static_cast<std::size_t>(options.limit)));
  if (versions.empty()) return Error{options.id + ": the ledger has nothing under it"};
  print(options, ledger::history_json(versions));
  fmt::print(stderr, "{}", ledger::history_note(options.id));  // beside the JSON
  return done;
}

/// A peer knows whole ids alone: of the beginning of one all its blocks are read.
Status search_at_peer(const Options& options, fabric::ClientConfig config, ledger::TransactionSearch& search) {
  constexpr std::chrono::seconds timeout(20);  // without a block, as `ledgerline audit` has it
  if (!search.is_whole_id()) {
    const auto reading =
        audit::read_peer(std::move(config), timeout, [&](std::string_view block) { search.add(std::string(block)); });
    if (!reading) return reading.error();
    return reading->problem.empty() ? Status(done) : Error{reading->problem};
  }
  const std::string channel = config.where.channel;
  const auto peer = fabric::PeerQueries::create(std::move(config));
  if (!peer) return peer.error();
  const auto block = (*peer)->query({channel, "qscc"}, {"GetBlockByTxID", {channel, options.transaction}});
  if (!block) return Error{fmt::format("transaction {}: {}", options.transaction, block.error().message)};
  search.add(*block);
  return done;
}

/// `config`: of the peer; none: in a copy.
Status transaction(const Options& options, std::optional<fabric::ClientConfig> config) {
  ledger::TransactionSearch search(options.transaction);
  if (config) {
    if (Status s = search_at_peer(options, std::move(*config), search); !s) return s;
  } else {
    const auto reading =
        audit::read_copy(options.blocks, [&](std::string_view block) { search.add(std::string(block)); });
    if (!reading) return reading.error();
    if (!reading->problem.empty()) search.add_damage(reading->problem);
  }
  const auto found = search.result();
  if (!found) return found.error();
  print(options, *found);
  return done;
}

constexpr const char* about =
    "What the ledger holds, decoded: the newest value of an id, its history, a transaction. Nothing is proven here: "
    "`ledgerline receipt` and `ledgerline audit` do that.";
constexpr const char* notes = R"(Examples:
  ledgerline ledger get --config operator.toml tello1/odom
  ledgerline ledger get --config operator.toml 'tello1/*'
  ledgerline ledger history --config operator.toml control/tello1 --limit 3
  ledgerline ledger tx --config operator.toml 3f5a...
  ledgerline ledger tx --blocks copy 3f5a... --json
Exit codes: 0 it is there; 1 it is not, or the ledger does not answer; 2 bad usage.)";

}  // namespace

int ledgerline::command::ledger(int argc, char** argv) {
  CommandLine line("ledgerline ledger", about, notes);
  Options options;
  Verb get_verb = line.verb("get", "the newest value of an id, or of all below PREFIX/*");
  get_verb.option("ID", options.id, "such as tello1/odom, control/tello1").required();
  Verb history_verb = line.verb("history", "what an id was before, newest first");
  history_verb.option("ID", options.id, "of what does not stream: states are in blocks (`ledgerline ledger tx`)")
      .required();
  history_verb.option("--limit", options.limit, "how many at most").within(1, 10'000).shows_default();
  Verb tx = line.verb("tx", "one transaction: who asked for what, who endorsed it, what became of it");
  tx.option("TX", options.transaction, "its id, or the beginning").required();
  const Option blocks =
      tx.option("--blocks", options.blocks, "in this copy of a chain, as `ledgerline audit` takes it").existing_path();
  for (Verb* verb : {&get_verb, &history_verb, &tx}) {
    Option config = verb->option("--config", options.config, "TOML file with [ledger]").existing_file();
    if (verb == &tx)
      config.excludes(blocks);
    else
      config.required();
    verb->flag("--json", options.json, "as JSON, in one line");
  }
  if (const auto end = line.parse(argc, argv)) return *end;
  if (!options.blocks.empty()) return exit_code(transaction(options, std::nullopt));
  if (options.config.empty()) return fail(Error{"name a peer (--config) or a copy (--blocks)"}, exit_usage);
  auto config = fabric::load_ledger_config(options.config);
  if (!config) return fail(config.error(), exit_usage);
  if (get_verb.is_given()) return exit_code(get(options, std::move(*config)));
  if (history_verb.is_given()) return exit_code(history(options, std::move(*config)));
  return exit_code(transaction(options, std::move(*config)));
}
