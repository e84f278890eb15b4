#pragma once
#include <cstdint>
#include <string>
#include <string_view>

#include "common/base/result.hpp"
#include "peer/transaction.pb.h"

/// Question and answer about a verdict, taken apart. Inside common/fabric/receipt alone.
namespace ledgerline::fabric {

template <typename Message>
bool parse(Message& message, std::string_view bytes) {
  return bytes.size() <= INT32_MAX && message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

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
