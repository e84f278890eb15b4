// What an audit costs beside the signature checks that it cannot do without: a chain of states and commands, made here
// with real keys and written to a file; then, block by block in turns, bare verifications of all its signatures, and
// the audit.
#include <fmt/format.h>
#include <malloc.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <map>

#include "tests/benchmarks/state_call.hpp"
#include "tests/unit/tools/audit/signed_ledger.hpp"

namespace {

using namespace ledgerline;
using audit::SignedLedger;

double resident_mb() {
  long pages = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> pages >> resident;
  return static_cast<double>(resident) * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1e6;
}

void write(std::ofstream& file, const std::string& block) {
  const auto size = static_cast<std::uint32_t>(block.size());
  file.write(reinterpret_cast<const char*>(&size), sizeof size);
  file.write(block.data(), static_cast<std::streamsize>(block.size()));
}

bool read(std::ifstream& file, std::string& block) {
  std::uint32_t size = 0;
  if (!file.read(reinterpret_cast<char*>(&size), sizeof size)) return false;
  block.resize(size);
  return static_cast<bool>(file.read(block.data(), size));
}

/// Half states, half commands. Returns the chain's first block.
std::string make_chain(std::ofstream& file, std::uint64_t transactions, std::uint64_t per_block) {
  SignedLedger ledger;
  ledger.enroll();
  ledger.acquire();
  ledger.submit(ledger.host, "set", state_call(1, ledger.now.real_ns));
  const std::string first = ledger.chain[0];
  std::uint64_t written = 0;
  const auto flush = [&] {
    for (; written < ledger.chain.size(); ++written) {
      write(file, ledger.chain[written]);
      std::string().swap(ledger.chain[written]);
    }
  };
  for (std::uint64_t i = 1; i <= transactions; ++i) {
    const bool command = i % 2 == 0;
    ledger.send(command ? ledger.pilot : ledger.host, command ? "command" : "set",
                command ? ledger.command_call(i, 1, static_cast<TimeNs>(i) * 20 * ns_per_ms)
                        : state_call(i + 1, ledger.now.real_ns));
    if (i % per_block == 0 || i == transactions) ledger.commit();
    flush();
  }
  return first;
}

/// A signature and what it is of, with nothing left to do but to verify it.
struct Check {
  std::shared_ptr<const crypto::Verifier> verifier;
  std::string message, signature;
};

class Checks {
 public:
  std::vector<Check> of(const std::string& bytes) {
    std::vector<Check> checks;
    common::Block block;
    if (!block.ParseFromString(bytes)) return checks;
    const auto decoded = fabric::decode_block(bytes);
    if (!decoded) return checks;
    common::Metadata signed_by;
    if (block.header().number() > 0 && signed_by.ParseFromString(block.metadata().metadata(common::SIGNATURES))) {
      const auto& header = block.header();
      for (const auto& one : signed_by.signatures()) {
        common::SignatureHeader who;
        if (!who.ParseFromString(one.signature_header())) continue;
        checks.push_back({verifier_of(who.creator()),
                          signed_by.value() + one.signature_header() +
                              fabric::block_header_bytes(header.number(), header.previous_hash(), header.data_hash()),
                          one.signature()});
      }
    }
    for (const fabric::Transaction& tx : decoded->transactions) {
      if (tx.config) continue;
      checks.push_back({verifier_of(tx.creator), tx.payload, tx.signature});
      for (const auto& e : tx.endorsements)
        checks.push_back({verifier_of(e.endorser), tx.response_payload + e.endorser, e.signature});
    }
    return checks;
  }

 private:
  std::shared_ptr<const crypto::Verifier> verifier_of(const std::string& serialized) {
    auto& known = known_[serialized];
    msp::SerializedIdentity identity;
    if (!known && identity.ParseFromString(serialized))
      known = *crypto::make_verifier(fabric::library, identity.id_bytes());
    return known;
  }
  std::map<std::string, std::shared_ptr<const crypto::Verifier>> known_;
};

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "An audit's time beside bare checks of the same signatures, and its memory.\n\nExample:\n"
      "  bench_audit --transactions 100000 --file /var/tmp/chain"};
  std::uint64_t transactions = 10'000, per_block = 10;
  std::string path;
  app.add_option("--transactions", transactions, "How many the chain has")->capture_default_str();
  app.add_option("--per-block", per_block, "Transactions a block")->capture_default_str()->check(CLI::Range(1, 1'000));
  app.add_option("--file", path, "Where the chain is made, and removed")->required();
  CLI11_PARSE(app, argc, argv);

  std::ofstream out(path, std::ios::binary);
  const std::string first = make_chain(out, transactions, per_block);
  out.close();
  ::malloc_trim(0);
  if (!out || ::testing::UnitTest::GetInstance()->ad_hoc_test_result().Failed()) {
    fmt::print(stderr, "the chain was not made\n");
    return 1;
  }
  std::ifstream in(path, std::ios::binary);
  auto chain_audit = audit::ChainAudit::start({"teleop", first});
  if (!chain_audit) {
    fmt::print(stderr, "{}\n", chain_audit.error().message);
    return 1;
  }
  Checks checks;
  TimeNs bare_ns = 0, audit_ns = 0;
  std::uint64_t signatures = 0, bad = 0;
  double early_mb = 0;
  std::string block;
  while (read(in, block)) {
    const auto due = checks.of(block);
    const TimeNs begin = monotonic_ns();
    for (const Check& check : due) bad += check.verifier->verify(check.message, check.signature) ? 0U : 1U;
    const TimeNs between = monotonic_ns();
    chain_audit->add(block);
    audit_ns += monotonic_ns() - between;
    bare_ns += between - begin;
    signatures += due.size();
    if (early_mb == 0 && chain_audit->counts().transactions > transactions / 10) early_mb = resident_mb();
  }
  chain_audit->end();
  std::remove(path.c_str());
  const double end_mb = resident_mb();
  const std::uint64_t all = chain_audit->counts().transactions;
  const auto each_us = [&](TimeNs ns) { return static_cast<double>(ns) / 1e3 / static_cast<double>(all); };
  fmt::print("{} transactions in {} blocks, {} signatures, {} of them bad, {} findings\n", all,
             chain_audit->counts().blocks, signatures, bad, chain_audit->counts().findings);
  fmt::print("bare checks {:.2f} s, {:.1f} us a transaction; audit {:.2f} s, {:.1f} us: ratio {:.3f}\n",
             to_seconds(bare_ns), each_us(bare_ns), to_seconds(audit_ns), each_us(audit_ns),
             static_cast<double>(audit_ns) / static_cast<double>(bare_ns));
  fmt::print("resident: {:.1f} MB after a tenth, {:.1f} MB at the end: {:.0f} bytes a transaction between\n", early_mb,
             end_mb, (end_mb - early_mb) * 1e6 / (0.9 * static_cast<double>(all)));
  return bad + chain_audit->counts().findings == 0 ? 0 : 1;
}
