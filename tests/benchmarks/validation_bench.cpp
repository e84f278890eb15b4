// What it costs agent that each transaction is validated, beside the signature checks that this needs: a chain of
// commands and states made here with real keys, each block in turns through agent's own check alone, through the
// stream's validation and the same check, and through bare verifications of its signatures.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <ctime>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "common/access/access.hpp"
#include "common/fabric/blocks/block_intake.hpp"
#include "common/msg/ros.hpp"
#include "common/rt/histogram.hpp"
#include "common/verification/calls.hpp"
#include "onboard/agent/core/command_check.hpp"
#include "peer/transaction.pb.h"
#include "tests/benchmarks/rounds.hpp"
#include "tests/benchmarks/state_call.hpp"
#include "tests/unit/tools/audit/signed_ledger.hpp"
#include "tools/launcher/machine.hpp"

namespace {

using namespace ledgerline;
using audit::SignedLedger;

constexpr TimeNs period_ns = 20 * ns_per_ms;  // of commands: 50 a second
constexpr double commands_per_s = 50, states_per_s = 30;
constexpr std::uint64_t boot_id = 7, epoch = 1;

[[noreturn]] void give_up(const std::string& why) {
  fmt::print(stderr, "{}\n", why);
  std::exit(1);
}

/// CPU time of this thread: what else the machine does is not in it, but for its caches.
TimeNs cpu_ns() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return now.tv_sec * ns_per_s + now.tv_nsec;
}

enum Kind : std::size_t { commands, states, kinds };
constexpr std::array<const char*, kinds> kind_names{"command", "state"};

/// An envelope that nobody has signed yet, with the first endorsements alone.
std::string endorsed_by_few(const std::string& bytes, int endorsements) {
  common::Envelope envelope;
  common::Payload payload;
  protos::Transaction transaction;
  protos::ChaincodeActionPayload action;
  if (!envelope.ParseFromString(bytes) || !payload.ParseFromString(envelope.payload()) ||
      !transaction.ParseFromString(payload.data()) || !action.ParseFromString(transaction.actions(0).payload()))
    give_up("the node made no transaction");
  auto& all = *action.mutable_action()->mutable_endorsements();
  while (all.size() > endorsements) all.RemoveLast();
  transaction.mutable_actions(0)->set_payload(action.SerializeAsString());
  payload.set_data(transaction.SerializeAsString());
  envelope.set_payload(payload.SerializeAsString());
  return envelope.SerializeAsString();
}

/// A signature and what it is of, with nothing left to do but to verify it.
struct Check {
  std::shared_ptr<const crypto::Verifier> verifier;
  std::string message, signature;
};

struct Step {
  common::Block block;
  Kind kind = commands;
  std::size_t transactions = 0;
  TimeNs answered_ns = 0;  ///< the newest state that its commands may answer
  std::vector<Check> checks;
};

struct Asked {
  int rounds = 40, blocks = 80, per_block = 1, endorsements = 1;
};

/// Blocks of commands and of states, five to three.
class Chain {
 public:
  explicit Chain(const Asked& asked) : asked_(asked) {
    ledger_.enroll();
    ledger_.acquire();
    ledger_.submit(ledger_.host, "set", state_call(++sequence_, ledger_.now.real_ns));
    begin_ = ledger_.chain.size();
    for (int i = 0; i < asked_.blocks; ++i) add(i % 8 < 5 ? commands : states);
    if (::testing::UnitTest::GetInstance()->ad_hoc_test_result().Failed()) give_up("the chain was not made");
  }

  const std::vector<Step>& steps() const { return steps_; }
  std::int64_t now_s() const { return ledger_.now.real_ns / ns_per_s; }

  fabric::BlockIntake make_intake(bool validates) const {
    auto intake = fabric::BlockIntake::make(
        {.where = {},
         .config_block = validates ? ledger_.chain[0] : std::string(),
         .make_registry = fabric::BlockValidator::registry_of(fabric::library),
         .contract_rules = {.likely_policy = [](const std::string& key) { return verification::likely_policy(key); }}});
    if (!intake) give_up(intake.error().message);
    intake->start_at(begin_);
    return std::move(*intake);
  }
  std::unique_ptr<crypto::MspRegistry> make_registry() const {
    std::vector<crypto::MspRoot> roots;
    for (const auto& one : ledger_.organisations) roots.push_back(one.root());
    return crypto::make_msp_registry(fabric::library, std::move(roots));
  }
  /// The pilot's.
  Control record() const {
    Control record;
    record.set_drone("tello1");
    *record.mutable_owner() = to_message(ledger_.host.name);
    *record.mutable_holder() = to_message(ledger_.pilot.name);
    record.set_epoch(epoch);
    return record;
  }

 private:
  void add(Kind kind) {
    for (int i = 0; i < asked_.per_block; ++i) {
      ++sequence_;
      ledger_.now.real_ns += period_ns;
      const auto& who = kind == commands ? ledger_.pilot : ledger_.host;
      const std::string call = kind == commands
                                   ? ledger_.command_call(sequence_, epoch, static_cast<TimeNs>(sequence_) * period_ns)
                                   : state_call(sequence_, ledger_.now.real_ns);
      const auto proposal = ledger_.propose(who, {kind == commands ? "command" : "set", {call}});
      const auto reply = ledger_.core->endorse(proposal.signed_proposal, ledger_.now);
      if (reply.code != node::Code::ok) give_up(reply.message + reply.detail);
      ledger_.order(who, endorsed_by_few(reply.bytes, asked_.endorsements));
    }
    ledger_.commit();
    Step step;
    step.kind = kind;
    step.transactions = static_cast<std::size_t>(asked_.per_block);
    if (!step.block.ParseFromString(ledger_.chain.back())) give_up("the node made no block");
    step.answered_ns = static_cast<TimeNs>(sequence_) * period_ns;
    step.checks = checks_of(step.block);
    steps_.push_back(std::move(step));
  }

  std::vector<Check> checks_of(const common::Block& block) {
    std::vector<Check> checks;
    common::Metadata signed_by;
    signed_by.ParseFromString(block.metadata().metadata(common::SIGNATURES));
    const auto& header = block.header();
    for (const auto& one : signed_by.signatures()) {
      common::SignatureHeader who;
      if (!who.ParseFromString(one.signature_header())) continue;
      checks.push_back({verifier_of(who.creator()),
                        signed_by.value() + one.signature_header() +
                            fabric::block_header_bytes(header.number(), header.previous_hash(), header.data_hash()),
                        one.signature()});
    }
    const auto decoded = fabric::decode_block(block.SerializeAsString());
    if (!decoded) give_up(decoded.error().message);
    for (const fabric::Transaction& tx : decoded->transactions) {
      if (tx.code != 0) give_up(fmt::format("a transaction is flagged {}", tx.code));
      checks.push_back({verifier_of(tx.creator), tx.payload, tx.signature});
      for (const auto& e : tx.endorsements)
        checks.push_back({verifier_of(e.endorser), tx.response_payload + e.endorser, e.signature});
    }
    return checks;
  }

  std::shared_ptr<const crypto::Verifier> verifier_of(const std::string& serialized) {
    auto& known = verifiers_[serialized];
    msp::SerializedIdentity identity;
    if (!known && identity.ParseFromString(serialized))
      known = *crypto::make_verifier(fabric::library, identity.id_bytes());
    return known;
  }

  Asked asked_;
  SignedLedger ledger_;
  std::uint64_t sequence_ = 0, begin_ = 0;
  std::vector<Step> steps_;
  std::map<std::string, std::shared_ptr<const crypto::Verifier>> verifiers_;
};

/// Agent's way from a peer's block to plans, validated or not.
class Reader {
 public:
  Reader(const Chain& chain, bool validates)
      : intake_(chain.make_intake(validates)), registry_(chain.make_registry()), now_s_(chain.now_s()) {
    check_.emplace(agent::CommandCheckSettings{}, std::vector<agent::DroneName>{{1, "tello1"}}, *registry_);
    check_->control().set_control(chain.record());
  }

  TimeNs read(const Step& step, std::size_t per_block) {
    for (std::size_t i = per_block; i-- > 0;) {
      StateSample state;
      state.drone = 1;
      state.boot_id = boot_id;
      state.stamp_ns = step.answered_ns - static_cast<TimeNs>(i) * period_ns;
      check_->add_sent_state(state);
    }
    const TimeNs begin = cpu_ns();
    const auto block = intake_.add(step.block, [](std::uint64_t) -> Result<common::Block> { return Error{"none"}; });
    if (!block) give_up(block.error().message);
    const auto checked = check_->check(step.answered_ns, now_s_, *block);
    const TimeNs took_ns = cpu_ns() - begin;
    const std::size_t plans = step.kind == commands ? step.transactions : 0;
    if (checked.plans.size() != plans || !checked.refused.empty() || checked.unverified > 0) {
      give_up(fmt::format(
          "block {}: {} plans of {} commands{}", block->number, checked.plans.size(), plans,
          checked.refused.empty() ? "" : fmt::format(", {}", agent::refusal_name(checked.refused.front().why))));
    }
    return took_ns;
  }
  const fabric::BlockIntake::Counts& counts() const { return intake_.counts(); }

 private:
  fabric::BlockIntake intake_;
  std::unique_ptr<crypto::MspRegistry> registry_;
  std::optional<agent::CommandCheck> check_;
  std::int64_t now_s_;
};

TimeNs verify(const Step& step) {
  bool good = true;
  const TimeNs begin = cpu_ns();
  for (const Check& check : step.checks) good = check.verifier->verify(check.message, check.signature) && good;
  const TimeNs took_ns = cpu_ns() - begin;
  if (!good) give_up("a signature does not fit");
  return took_ns;
}

enum Way : std::size_t { unvalidated, validated, bare, ways };
constexpr std::array<const char*, ways> way_names{"agent's check alone", "validated, and agent's check",
                                                  "bare signatures"};

/// Microseconds a transaction, of one round.
using Round = std::array<std::array<double, kinds>, ways>;

Round measure(const Chain& chain, int turn, std::size_t per_block, fabric::BlockIntake::Counts& counts) {
  Reader plain(chain, false), validating(chain, true);
  std::array<std::array<TimeNs, kinds>, ways> took{};
  std::array<std::size_t, kinds> transactions{};
  constexpr std::size_t warm_up = 8;  // certificates are checked once
  for (std::size_t i = 0; i < chain.steps().size(); ++i) {
    const Step& step = chain.steps()[i];
    for (std::size_t k = 0; k < ways; ++k) {
      const auto way = static_cast<Way>((k + i + static_cast<std::size_t>(turn)) % ways);
      const TimeNs took_ns = way == unvalidated ? plain.read(step, per_block)
                             : way == validated ? validating.read(step, per_block)
                                                : verify(step);
      if (i >= warm_up) took[way][step.kind] += took_ns;
    }
    if (i >= warm_up) transactions[step.kind] += step.transactions;
  }
  counts = validating.counts();
  Round round{};
  for (std::size_t way = 0; way < ways; ++way) {
    for (std::size_t kind = 0; kind < kinds; ++kind)
      round[way][kind] = static_cast<double>(took[way][kind]) / 1e3 / static_cast<double>(transactions[kind]);
  }
  return round;
}

/// Of `value` of each round.
template <typename Value>
Quartiles over(const std::vector<Round>& rounds, Value value) {
  std::vector<double> values;
  for (const Round& round : rounds) values.push_back(value(round));
  return quartiles(std::move(values));
}

double share_percent(double command_us, double state_us) {
  return (commands_per_s * command_us + states_per_s * state_us) / 1e4;
}

/// Prints a line, and keeps it.
void tell(nlohmann::json& figures, const std::string& name, const Quartiles& q, const char* unit) {
  fmt::print("  {:<52}{:>8.2f} {:<3} ({:.2f} to {:.2f})\n", name, q.median, unit, q.q1, q.q3);
  figures[name] = q;
}

nlohmann::json tell(const std::vector<Round>& rounds) {
  nlohmann::json figures;
  for (std::size_t kind = 0; kind < kinds; ++kind) {
    const auto name = [&](const char* what) { return fmt::format("{}: {}", kind_names[kind], what); };
    for (std::size_t way = 0; way < ways; ++way)
      tell(figures, name(way_names[way]), over(rounds, [&](const Round& r) { return r[way][kind]; }), "us");
    tell(figures, name("difference"),
         over(rounds, [&](const Round& r) { return r[validated][kind] - r[unvalidated][kind]; }), "us");
    tell(figures, name("validated / bare"),
         over(rounds, [&](const Round& r) { return r[validated][kind] / r[bare][kind]; }), "");
  }
  const auto share = [&](Way way, bool with_states) {
    return over(rounds,
                [=](const Round& r) { return share_percent(r[way][commands], with_states ? r[way][states] : 0); });
  };
  tell(figures, "50 commands/s, validated: of a core", share(validated, false), "%");
  tell(figures, "50 commands/s and 30 states/s, validated: of a core", share(validated, true), "%");
  tell(figures, "the same, agent's check alone", share(unvalidated, true), "%");
  tell(figures, "the same, bare signatures", share(bare, true), "%");
  tell(figures, "the same, difference",
       over(rounds,
            [](const Round& r) {
              return share_percent(r[validated][commands] - r[unvalidated][commands],
                                   r[validated][states] - r[unvalidated][states]);
            }),
       "%");
  return figures;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "CPU time that validating each transaction costs agent, beside the signature checks that it needs "
      "(libcrypto).\n\nExample:\n"
      "  bench_validation --rounds 40 --endorsements 1"};
  Asked asked;
  std::string json;
  app.add_option("--rounds", asked.rounds, "How often the chain is read; each block in turns")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--blocks", asked.blocks, "Of the chain; more than 16")
      ->check(CLI::Range(17, 10'000))
      ->capture_default_str();
  app.add_option("--per-block", asked.per_block, "Transactions a block, all commands or all states")
      ->check(CLI::Range(1, 20))
      ->capture_default_str();
  app.add_option("--endorsements", asked.endorsements, "A transaction: 1 on Fabric, 3 on the embedded node")
      ->check(CLI::Range(1, 3))
      ->capture_default_str();
  app.add_option("--json", json, "Where the figures go as one object");
  CLI11_PARSE(app, argc, argv);

  const double load_before = load_average();
  const Chain chain(asked);
  std::vector<Round> rounds;
  fabric::BlockIntake::Counts counts;
  for (int turn = 0; turn < asked.rounds; ++turn)
    rounds.push_back(measure(chain, turn, static_cast<std::size_t>(asked.per_block), counts));
  fmt::print(
      "{} rounds of {} blocks, {} transactions each, {} endorsements; CPU time, a round's mean a transaction, median "
      "of rounds (quartiles); {} validated, {} by flag, {} differ; load {:.1f} before, {:.1f} after\n",
      asked.rounds, asked.blocks, asked.per_block, asked.endorsements, counts.validated, counts.by_flag, counts.differ,
      load_before, load_average());
  const nlohmann::json figures = tell(rounds);
  if (counts.differ > 0) give_up("the validation differs from the flags");
  if (json.empty()) return 0;
  const launcher::Machine machine = launcher::describe_machine();
  std::ofstream file(json);
  file << nlohmann::json{{"asked",
                          {{"rounds", asked.rounds},
                           {"blocks", asked.blocks},
                           {"per_block", asked.per_block},
                           {"endorsements", asked.endorsements}}},
                         {"machine", {{"cpu", machine.cpu}, {"cores", machine.cores}, {"system", machine.system}}},
                         {"load", {{"before", load_before}, {"after", load_average()}}},
                         {"figures", figures}}
              .dump(2)
       << '\n';
  file.close();
  if (!file) give_up("cannot write " + json);
}
