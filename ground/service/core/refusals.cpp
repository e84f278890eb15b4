#include "ground/service/core/board.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/text.hpp"

namespace ledgerline::ground::service {
namespace {

constexpr TimeNs gap_ns = ns_per_s;
constexpr std::size_t max_words = 300;  // bytes of what a peer says

std::string text_of(std::string_view function, const fabric::Outcome& outcome) {
  const std::string words = printable(outcome.refusal ? outcome.refusal->words : outcome.message, max_words);
  using Kind = fabric::Outcome::Kind;
  switch (outcome.kind) {
    case Kind::committed:
      return "";
    case Kind::invalidated:
      return fmt::format("{} does not count: invalid in block {} (code {}){}{}", function, outcome.block, outcome.code,
                         words.empty() ? "" : ": ", words);
    case Kind::refused:
      return fmt::format("{} refused: {}", function, words);
    case Kind::unavailable:
      return fmt::format("{}: no answer of the ledger: {}", function, words);
    case Kind::overloaded:
      return fmt::format("{} not sent, too many are in flight: {}", function, words);
  }
  return fmt::format("{} did not get through", function);
}

}  // namespace

void Refusals::take(std::string_view function, const fabric::Outcome& outcome) {
  if (outcome.kind == fabric::Outcome::Kind::committed) return;
  const auto named = std::find_if(names_.begin(), names_.end(), [&](const std::string& name) {
    return outcome.refusal && fabric::names(*outcome.refusal, name);
  });
  Slot& slot = slots_[{named == names_.end() ? std::string() : *named, outcome.kind}];
  slot.text = text_of(function, outcome);
  ++slot.count;
}

std::vector<Refusals::RefusalNotice> Refusals::due(TimeNs now) {
  std::vector<RefusalNotice> said;
  for (auto& [key, slot] : slots_) {
    if (slot.count == 0 || now < slot.next_ns) continue;
    said.push_back({key.first, slot.count == 1 ? slot.text : fmt::format("{} ({} times)", slot.text, slot.count)});
    slot.count = 0;
    slot.next_ns = now + gap_ns;
  }
  return said;
}

}  // namespace ledgerline::ground::service
