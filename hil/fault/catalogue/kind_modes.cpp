#include "hil/fault/catalogue/kind_modes.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <optional>

#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

/// What stands for a word in capitals, behind that word in lower case; behind any where `behind` is empty.
struct Stand {
  std::string_view behind, word, example;
};
constexpr Stand stand_ins[] = {
    {"lies", "WHAT...", "chain"},
    {"serves", "WHAT...", "hides-commands"},
    {"orders", "WHAT...", "hides-commands"},
    {"errs", "WHAT...", "boot"},
    {"relay", "LIE...", "plan-speed"},
    {"answers", "WHAT...", "late 300ms"},
    {"states", "WHAT...", "torn"},
    {"ledger", "EFFECTS...", "loss 5%"},
    {"", "EFFECTS...", "delay 200ms"},
    {"", "DISTRIBUTION...", "gamma 50ms 20ms"},
    {"", "FIELD...", "h stuck"},
    {"", "NAME", "tello1"},
    {"", "SHARE", "7%"},
    {"", "X", "0.5"},
    {"", "Y", "0.1"},
    {"", "Z", "0.1"},
    {"", "DEGREES", "90"},
    {"", "METRES", "0.02"},
    {"", "CELSIUS", "97"},
    {"", "TIME", "100ms"},
    {"", "RATE", "0.05"},
    {"", "N", "1"},
    {"", "SIZE", "500MB"},
};

/// `text`: the fault as far as its words are known.
std::optional<std::string_view> example_for(std::string_view placeholder, const std::string& text) {
  const auto before = words_of(text);
  for (const Stand& stand : stand_ins) {
    const bool fits = stand.behind.empty() || std::find(before.begin(), before.end(), stand.behind) != before.end();
    if (stand.word == placeholder && fits) return stand.example;
  }
  return std::nullopt;
}

std::vector<std::string_view> choices_in(std::string_view word) {
  std::vector<std::string_view> choices;
  for (std::size_t begin = 0; begin <= word.size();) {
    const std::size_t end = std::min(word.find('|', begin), word.size());
    choices.push_back(word.substr(begin, end - begin));
    begin = end + 1;
  }
  return choices;
}

// Lasting a second, where it lasts at all: in that time each kind can be had, if ever.
std::string refusal_of(const std::string& text, bool real, const RealStack& stack) {
  auto fault = parse_fault(text, "", "", real);
  if (fault && !fault->acts.momentary) fault = parse_fault(text, "", "1s", real);
  if (!fault) return fault.error().what;
  return real && fault->acts.not_real ? fault->acts.not_real(*fault, stack) : "";
}

InMode in_mode(const std::vector<std::string>& examples, bool real, const RealStack& stack) {
  InMode mode;
  for (const std::string& example : examples) {
    std::string why = refusal_of(example, real, stack);
    if (why.empty())
      mode.possible.push_back(example);
    else
      mode.refused.emplace_back(example, std::move(why));
  }
  return mode;
}

/// "real" where all examples are possible, else with those that are; empty: none is.
std::string said_of(std::string_view name, const InMode& mode) {
  if (mode.possible.empty()) return "";
  return mode.all() ? std::string(name) : fmt::format("{}: `{}`", name, fmt::join(mode.possible, "`, `"));
}

}  // namespace

bool is_placeholder(std::string_view word) { return std::isupper(static_cast<unsigned char>(word[0])) != 0; }

std::vector<std::string> examples_of(const FaultKind& kind) {
  std::vector<std::string> examples{""};
  for (const std::string_view word : words_of(kind.form)) {
    std::vector<std::string> longer;
    for (const std::string& text : examples) {
      std::vector<std::string_view> choices = choices_in(word);
      if (is_placeholder(word)) {
        const auto example = example_for(word, text);
        if (!example) return {};
        choices = {*example};
      }
      for (const std::string_view choice : choices)
        longer.push_back(text.empty() ? std::string(choice) : fmt::format("{} {}", text, choice));
    }
    examples = std::move(longer);
  }
  return examples;
}

KindModes modes_of(const FaultKind& kind) {
  const auto examples = examples_of(kind);
  return {&kind, in_mode(examples, false, {}), in_mode(examples, true, {.fabric = false}),
          in_mode(examples, true, {.fabric = true}), in_mode(examples, true, {.shim = true})};
}

std::string modes_text(const KindModes& modes) {
  std::vector<std::string> said;
  if (const auto text = said_of("sitl", modes.sitl); !text.empty()) said.push_back(text);
  if (modes.embedded.possible == modes.fabric.possible) {
    if (const auto text = said_of("real", modes.embedded); !text.empty()) said.push_back(text);
  } else {
    if (const auto text = said_of("real on the embedded node", modes.embedded); !text.empty()) said.push_back(text);
    if (const auto text = said_of("real on Fabric", modes.fabric); !text.empty()) said.push_back(text);
  }
  if (modes.shim.possible != modes.embedded.possible) {
    if (const auto text = said_of("real over the shim", modes.shim); !text.empty()) said.push_back(text);
  }
  if (!said.empty()) return fmt::format("{}", fmt::join(said, ", "));
  return modes.sitl.refused.empty() ? "refused" : "refused: " + modes.sitl.refused.front().second;
}

}  // namespace ledgerline::hil
