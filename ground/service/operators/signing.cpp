#include "ground/service/operators/signing.hpp"

#include <fmt/format.h>

namespace ledgerline::ground::service {

std::string not_signed(const KeyState& key, OperatorCall::Kind kind) {
  return key.unlocked && (!key.left || kind == OperatorCall::Kind::release) ? "" : "the session is over";
}

bool may_clear_ground_stop(const fabric::Outcome& outcome, const std::string& drone) {
  return outcome.refusal && outcome.refusal->about == drone;
}

CallUpdate news_of(const std::string& name, const OperatorCall& call, const std::string& why) {
  return {Level::warning, fmt::format("{}: {}: not signed: {}", name, words_of(call), why)};
}

CallUpdate news_of(const std::string& name, const OperatorCall& call, const fabric::Outcome& outcome) {
  const std::string what = fmt::format("{}: {}", name, words_of(call));
  if (outcome.kind == fabric::Outcome::Kind::committed) return {Level::info, what};
  return {Level::warning,
          fmt::format("{}: refused: {}", what, outcome.refusal ? outcome.refusal->words : outcome.message)};
}

}  // namespace ledgerline::ground::service
