#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"

namespace protos {
class ProcessedTransaction;
}

/// A receipt: one file that shows what became of one transaction, to somebody who has no network and trusts nobody
/// but the authorities of the channel's organisations and orderers (receipt_verifier.hpp). Pure.
namespace ledgerline::fabric {
struct ClientConfig;

struct Receipt {
  /// A signature of somebody who is named beside it: orderers sign `block.orderers_value`, `signer` and the header;
  /// peers sign the answer and `signer`.
  struct Signature {
    std::string signer;     ///< an orderer's common.SignatureHeader, or a peer's msp.SerializedIdentity
    std::string signature;  ///< DER
  };
  /// What orderers sign of a block, and all that follows from it. No flags: nobody signs them.
  struct Block {
    std::uint64_t number = 0;
    std::string previous_hash, data_hash;
    std::vector<std::string> data;  ///< common.Envelope of every transaction in it, other people's as well
    std::string orderers_value;     ///< what they sign beside the header: common.OrdererBlockMetadata
    std::vector<Signature> orderers;
  };
  /// What a peer answered to `question`.
  struct Answer {
    std::string payload;  ///< protos.ProposalResponsePayload
    Signature endorsement;
  };
  std::string channel, tx_id;
  Block block;
  std::string question;         ///< protos.Proposal: qscc GetTransactionByID
  std::vector<Answer> answers;  ///< one of each organisation, in the order of their names
};

/// A larger file is no receipt. Twice Fabric's largest message (100 MB), since the transaction is in block and answers.
inline constexpr std::size_t max_receipt_bytes = 200'000'000;

/// The file: a first line that says what it is, then each value with its length in front. A receipt has one form only,
/// so that no byte of it can be another without the receipt being another one.
std::string receipt_bytes(const Receipt& receipt);
/// The way back; nothing but the layout is checked.
Result<Receipt> read_receipt(std::string_view bytes);

/// What a peer said when it was asked.
struct PeerAnswer {
  std::string peer;      ///< who was asked, for messages
  std::string response;  ///< protos.ProposalResponse
};

/// The contract of every peer of Fabric that knows its chain, and what it is asked for a verdict.
inline constexpr const char* chain_contract = "qscc";
inline constexpr const char* verdict_function = "GetTransactionByID";

/// Puts a receipt together: `block`, a common.Block that holds the transaction, and `answers` to `signed_question`, a
/// protos.SignedProposal that asks chain_contract for the transaction's verdict. An error names the peer whose answer
/// is none, and the peers that say different things. Nothing is verified: that needs to know whom to trust.
Result<Receipt> make_receipt(const std::string& channel, const std::string& tx_id, std::string_view block,
                             std::string_view signed_question, const std::vector<PeerAnswer>& answers);

struct CollectedReceipt {
  Receipt receipt;
  std::vector<std::string> unheard;  ///< peers that were not reached or refused, and why
};

/// Asks the ledger for all that a receipt of transaction `tx_id` is made of: the own peer for its block, and for the
/// verdict a peer of each organisation of `config.endorsers`, and the own one where none of those is of the own
/// organisation. Waits for each at most `config.deadline`. An error: there is no such transaction, no peer answers, or
/// the peers differ. One thread.
Result<CollectedReceipt> collect_receipt(ClientConfig config, const std::string& tx_id);

// Question and answer about a verdict, taken apart: for make_receipt and ReceiptVerifier.

struct Question {
  std::string hash;         ///< what ties answers to it
  std::int64_t time_s = 0;  ///< Unix time, by the asker's word
};
/// Reads a protos.Proposal. An error: it does not ask chain_contract for the verdict on that transaction, in the one
/// form that a question has. (The hash is over three texts, one behind the other, and does not say where one ends.)
Result<Question> read_question(std::string_view question, const std::string& channel, const std::string& tx_id);

/// What a peer said: the transaction as its chain has it, with its code. `payload`: protos.ProposalResponsePayload.
/// An error: it is no answer to the question with that hash.
Result<protos::ProcessedTransaction> read_answer(std::string_view payload, const std::string& hash);

/// VALID, or the name of another protos.TxValidationCode.
std::string name_of_code(int code);

}  // namespace ledgerline::fabric
