#include "tests/fuzz/entry.hpp"
#include "tests/unit/common/fabric/receipt/ledger_of_receipts.hpp"

/// What is handed over as a receipt, and what peers answer to who makes one.
namespace ledgerline::fuzz::receipt_part {
namespace {

using namespace fabric;

class Ledger : public LedgerOfReceipts {
 public:
  Ledger() : sent(committed(0, "mine")), good(receipt(sent)), asked(question(sent.tx_id)) {}
  const Sent sent;
  const Receipt good;
  const std::string asked;
  const ReceiptVerifier verifier = make_verifier();
};
Ledger& ledger() {
  static Ledger one;
  return one;
}

/// Only what was made is proven: what another receipt proves would be a forgery.
Outcome verify(const std::string& bytes) {
  const auto proven = ledger().verifier.verify(bytes);
  EXPECT_TRUE(!proven || bytes == receipt_bytes(ledger().good)) << "a changed receipt is proven";
  return outcome_of(proven);
}

/// `put`: the place in the receipt that is the input.
std::unique_ptr<Entry> place(const std::function<std::string&(Receipt&)>& put) {
  Receipt receipt = ledger().good;
  return std::make_unique<Function>(std::vector<std::string>{put(receipt)}, [put](std::string_view bytes) {
    Receipt bent = ledger().good;
    put(bent) = bytes;
    return verify(receipt_bytes(bent));
  });
}

std::unique_ptr<Entry> file() {
  return std::make_unique<Function>(std::vector<std::string>{receipt_bytes(ledger().good)},
                                    [](std::string_view bytes) { return verify(std::string(bytes)); });
}

std::unique_ptr<Entry> answered() {
  return std::make_unique<Function>(
      std::vector<std::string>{ledger().answer(ledger().asked, 0).response}, [](std::string_view bytes) {
        return outcome_of(make_receipt("teleop", ledger().sent.tx_id, ledger().chain.at(ledger().sent.block),
                                       ledger().asked, {{"peer", std::string(bytes)}}));
      });
}

// Any change is refused, so only what a mutation left as it was is accepted.
const Registration files({"receipt.file", Kind::bytes, file, 0.2, 0});
const Registration envelopes({"receipt.envelope", Kind::protobuf,
                              [] { return place([](Receipt& r) -> std::string& { return r.block.data[0]; }); }, 0.2,
                              0});
const Registration orderers(
    {"receipt.orderer", Kind::protobuf,
     [] { return place([](Receipt& r) -> std::string& { return r.block.orderers[0].signer; }); }, 0.2, 0});
const Registration questions({"receipt.question", Kind::protobuf,
                              [] { return place([](Receipt& r) -> std::string& { return r.question; }); }, 0.2, 0});
const Registration answers({"receipt.answer", Kind::protobuf,
                            [] { return place([](Receipt& r) -> std::string& { return r.answers[0].payload; }); }, 0.2,
                            0});
const Registration responses({"receipt.response", Kind::protobuf, answered, 0.05});

}  // namespace
}  // namespace ledgerline::fuzz::receipt_part
