// Single bytes of a copy are changed: in a block's header, its data, its orderers' signatures. Each must be found. A
// slice in every test run; 10,000 with LEDGERLINE_LONG=1.
#include <gmock/gmock.h>
#include <google/protobuf/stubs/logging.h>

#include "common/base/random.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/tools/audit/signed_ledger.hpp"

namespace ledgerline::audit {
namespace {

/// Where header, data and signatures stand in a block's bytes.
std::vector<std::size_t> places_of(const std::string& bytes) {
  common::Block block;
  EXPECT_TRUE(block.ParseFromString(bytes));
  std::vector<std::size_t> places;
  const std::size_t before_metadata = bytes.size() - block.metadata().ByteSizeLong();
  for (std::size_t i = 0; i < before_metadata - 4; ++i)
    places.push_back(i);  // header and data; tag and length are behind
  const std::string& signatures = block.metadata().metadata(common::SIGNATURES);
  const std::size_t at = signatures.empty() ? std::string::npos : bytes.find(signatures, before_metadata);
  for (std::size_t i = 0; at != std::string::npos && i < signatures.size(); ++i) places.push_back(at + i);
  return places;
}

TEST(TamperingTest, EachChangedByteIsFoundWhereItIs) {
  google::protobuf::SetLogHandler(nullptr);  // a line for each string that is no UTF-8
  SignedLedger ledger;
  ledger.enroll();
  ledger.acquire();
  for (int i = 1; i <= 3; ++i) ledger.send(ledger.pilot, "command", ledger.command_call(i, 1, i));
  ledger.commit();
  ledger.submit(ledger.pilot, "stop", SignedLedger::drones_call());
  std::vector<std::vector<std::size_t>> places;
  for (const std::string& block : ledger.chain) places.push_back(places_of(block));
  const Trust anchor = ledger.trust();
  Random random(20);
  const int changes = seeds(slow ? 100 : 400, slow ? 2'000 : 10'000);
  for (int i = 0; i < changes; ++i) {
    const std::size_t number = random.next() % ledger.chain.size();
    std::string& block = ledger.chain[number];
    const std::size_t at = places[number][random.next() % places[number].size()];
    const char before = block[at];
    const int bit = static_cast<int>(random.next() % 255) + 1;
    block[at] = static_cast<char>(before ^ bit);
    const ChainAudit audit = audited(ledger.chain, anchor);
    ASSERT_FALSE(audit.findings().empty()) << "block " << number << ", byte " << at << ", changed by " << bit;
    ASSERT_EQ(audit.findings()[0].block, number) << to_text(audit.findings()[0]);
    block[at] = before;
  }
  EXPECT_THAT(audited(ledger.chain, ledger.trust()).findings(), ::testing::IsEmpty());
}

}  // namespace
}  // namespace ledgerline::audit
