#include <fmt/format.h>
#include <google/protobuf/stubs/logging.h>

#include <iostream>
#include <nlohmann/json.hpp>

#include "common/base/file.hpp"
#include "common/base/utc.hpp"
#include "common/fabric/config.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/audit/chain_audit.hpp"
#include "tools/audit/source.hpp"
#include "tools/command/verbs.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::audit;

constexpr int exit_found = 1, exit_unreadable = 2;

struct Options {
  std::string blocks, config, anchor, channel = "teleop", newest, save, json, html, from, to;
  std::vector<std::string> drones;
  bool trust_first_block = false;
  double timeout_s = 20;
};

int fail_unreadable(const std::string& what) {
  fmt::print(stderr, "audit: {}\n", what);
  return exit_unreadable;
}

/// What goes where: set by what was asked for, before anything is read.
struct Plan {
  Trust trust;
  AuditRequest asked;
  std::optional<fabric::ClientConfig> peer;
};

/// As parse_time_ns() has it, or as audits print it: "2026-11-29 01:02:03". An empty one leaves `time_ns` as it is.
Status read_time(const char* option, std::string text, TimeNs& time_ns) {
  if (text.empty()) return done;
  if (constexpr std::size_t date = 10; text.size() > date && text[date] == ' ') {
    text[date] = 'T';
    text += 'Z';
  }
  const auto time = parse_time_ns(text);
  if (!time) return Error{fmt::format("{}: {}", option, time.error().message)};
  time_ns = *time;
  return done;
}

Result<Plan> make_plan(const Options& options) {
  Plan plan;
  plan.trust.channel = options.channel;
  plan.asked.source = "the copy in " + options.blocks;
  if (!options.config.empty()) {
    auto ledger = fabric::load_ledger_config(options.config);
    if (!ledger) return ledger.error();
    plan.trust.channel = ledger->where.channel;
    plan.trust.anchor = ledger->config_block;
    plan.asked.source = "the peer at " + ledger->endpoint;
    if (!ledger->config_block.empty()) plan.asked.anchor = "config_block of " + options.config;
    plan.peer = std::move(*ledger);
  }
  if (!options.anchor.empty()) {
    auto anchor = read_file(options.anchor);
    if (!anchor) return anchor.error();
    plan.trust.anchor = std::move(*anchor);
    plan.asked.anchor = options.anchor;
  }
  if (!options.newest.empty()) {
    const auto hash = crypto::unhex(options.newest);
    if (!hash || hash->size() != crypto::Digest{}.size())
      return Error{"--newest: a block's hash has 64 digits, 0 to 9 and a to f"};
    plan.trust.newest = crypto::hex(*hash);
  }
  plan.asked.channel = plan.trust.channel;
  plan.asked.drones.insert(options.drones.begin(), options.drones.end());
  TimeSpan& span = plan.asked.span;
  if (Status s = read_time("--from", options.from, span.from_ns); !s) return s.error();
  if (Status s = read_time("--to", options.to, span.to_ns); !s) return s.error();
  if (span.from_ns > span.to_ns) return Error{"--from is behind --to"};
  if (plan.trust.anchor.empty() && !options.trust_first_block)
    return Error{
        "name a config block of the channel that you trust (--anchor FILE, or config_block in --config FILE); "
        "--trust-first-block takes the chain's own word for it"};
  if (!plan.trust.anchor.empty() && options.trust_first_block)
    return Error{"--trust-first-block is for who has no trust anchor"};
  return plan;
}

int run(const Options& options) {
  google::protobuf::SetLogHandler(nullptr);  // a line for each string that is no UTF-8: findings say what is wrong
  auto plan = make_plan(options);
  if (!plan) return fail_unreadable(plan.error().message);
  auto audit = ChainAudit::start(plan->trust, plan->asked.span);
  if (!audit) return fail_unreadable("the trust anchor: " + audit.error().message);
  Status saved = done;
  const OnBlock on_block = [&](std::string_view block) {
    if (!options.save.empty() && saved) saved = save_block(options.save, audit->height(), block);
    audit->add(block);
  };
  const std::chrono::milliseconds timeout(static_cast<int>(1e3 * options.timeout_s));
  const auto reading =
      plan->peer ? read_peer(std::move(*plan->peer), timeout, on_block) : read_copy(options.blocks, on_block);
  if (!reading) return fail_unreadable(reading.error().message);
  if (!reading->problem.empty()) audit->add_reader_finding(reading->problem);
  audit->end();
  for (const std::string& drone : plan->asked.drones) {
    if (!audit->report().drones().contains(drone)) return fail_unreadable("--drone: the chain knows no " + drone);
  }

  if (options.json != "-") std::cout << to_table(*audit, plan->asked) << std::flush;
  const nlohmann::json document = to_json(*audit, plan->asked);
  Status written = saved;
  if (options.json == "-") {
    std::cout << document.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) << std::endl;
  } else if (written && !options.json.empty()) {
    written = write_file(options.json, document.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
  }
  if (written && !options.html.empty()) written = write_file(options.html, to_page(document));
  if (!written) return fail_unreadable(written.error().message);
  return audit->counts().findings == 0 ? EXIT_SUCCESS : exit_found;
}

constexpr const char* about =
    "Validates a channel's whole chain, from a peer or from a copy without any network, trusting no flag: who "
    "commanded, held and stopped which drone, and the first transaction that is not as it must be.";
constexpr const char* notes = R"(Examples:
  ledgerline audit --config operator.toml --html audit.html
  ledgerline audit --config operator.toml --save copy
  ledgerline audit --blocks copy --anchor teleop.block --drone tello1 --from 2026-11-29T01:02:03Z --json flight.json
  ledgerline audit --blocks copy --anchor teleop.block
  ledgerline audit --blocks OUT --anchor OUT/ledger/teleop.block --json -       # of ledgerline fly --out OUT, not on Fabric
A copy: the folder of a ledgerline-node or flight that has ended, or one with 0.block, 1.block ... as --save and
`peer channel fetch N` write them. Without flags (an orderer's blocks) there is nothing to compare verdicts with.
Exit codes: 0 nothing found; 1 something is not as it must be: the last line names the first such thing;
2 bad usage, or nothing that can be read.)";

void add_options(CommandLine& line, Options& o) {
  line.option("--config", o.config, "TOML file with [ledger], as of ledgerline control: audit what that peer has")
      .existing_file();
  line.option("--blocks", o.blocks, "Audit this copy of a chain").existing_path();
  line.option("--anchor", o.anchor, "A config block of the channel that you trust (CHANNEL.block)").existing_file();
  line.flag("--trust-first-block", o.trust_first_block, "Without an anchor: take the chain's first block as it is");
  line.option("--newest", o.newest, "The newest block's hash, as others have it: another one is a finding");
  line.option("--channel", o.channel, "The channel of a copy").shows_default();
  line.option("--drone", o.drones, "Tell of this one alone; may be given again. The whole chain is checked")
      .one_at_a_time();
  line.option("--from", o.from, "Tell of what is claimed to be from then on: 2026-11-29T01:02:03.5Z, or s since 1970");
  line.option("--to", o.to, "And of nothing behind that");
  line.option("--save", o.save, "Write every block into this folder, for later audits");
  line.option("--timeout", o.timeout_s, "Seconds without a block after which a peer's chain ends")
      .within(1.0, 600.0)
      .shows_default();
  line.option("--json", o.json, "Write everything to this file as one JSON object; -: to standard output, alone");
  line.option("--html", o.html, "Write a page that opens without a network");
}

}  // namespace

int ledgerline::command::audit(int argc, char** argv) {
  CommandLine line("ledgerline audit", about, notes);
  line.renamed("--patience", "--timeout");
  Options o;
  add_options(line, o);
  if (const auto end = line.parse(argc, argv)) return *end;
  if (o.config.empty() == o.blocks.empty())
    return fail_unreadable("name a copy (--blocks) or a peer (--config): see --help");
  return run(o);
}
